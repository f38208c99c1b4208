"""The exact walk of a gait: walk_qp solved about its own answer until (8) holds.

Long walks have motions that cost next to nothing, such as a slow bounce of the body, and the answers drift along them.
After some rounds a term that vanishes at the answer keeps each one near the one before.
"""

from dataclasses import replace

import numpy as np

from crux_planner.model.gait import WalkMotion
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.walk_dynamics import defects
from crux_planner.solvers import clock
from crux_planner.trajectory.solution import WalkSolution
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots

_ROUNDS = 16
_FREE_ROUNDS = 8  # after them an answer is held to the one before
_HOLDING = 100.0  # rho of that
_NEARER = 0.8  # an answer is to be than the one before: two may else follow one another for ever
_ACCURACY = 1e-7  # of the QP
_MOMENT_NM, _FORCE_N, _PLACE = 1e-4, 1e-3, 1e-6  # left open by (8) at most
_COST = 1e-5  # of J, as a share, from one answer to the next


def solve(problem: WalkProblem, knots: WalkKnots, deadline: float) -> WalkSolution:
    """P1 of one gait, from a walk near its solution."""
    qp, cost, before = ContactQp(problem, None), np.inf, np.inf
    about: WalkMotion = knots
    for count in range(1, _ROUNDS + 1):
        held = count > _FREE_ROUNDS
        again = _held(problem, knots) if held else qp.solve(about, accuracy=_ACCURACY)
        if again is None or clock.now() > deadline:
            break
        settled = abs(again.cost - cost) < _COST * abs(again.cost)
        knots, cost = again, again.cost
        solution = of_knots(problem, knots, count)
        if settled and solution.solved:
            return solution
        away = float(np.abs(knots.body - about.body).max())
        nearer = away < _NEARER * before
        about, before = knots if nearer else about.halfway(knots), away
    status = "Time is over" if clock.now() > deadline else "its answers do not settle"
    return replace(of_knots(problem, knots, count), solved=False, status=status)


def _held(problem: WalkProblem, knots: WalkKnots) -> WalkKnots | None:
    """The next answer, near the one before."""
    from crux_planner.trajectory.consensus import Eta, Scales

    near = Eta.of_points(knots.body, knots.feet(problem.step_height_m), knots.forces)
    return ContactQp(problem, Scales()).solve(knots, _HOLDING, near, _ACCURACY)


def of_knots(problem: WalkProblem, knots: WalkKnots, iterations: int) -> WalkSolution:
    """A walk as it is; `solved` where (8) holds."""
    feet, yaws = knots.feet(problem.step_height_m), knots.gait.yaw(float(problem.goal.body.rpy_rad[2]))
    left = np.abs(defects(problem, knots.body, feet, yaws, knots.forces))
    moment = float((left[:, 9:12] @ np.abs(problem.inertia_b).T).max()) / problem.dt_s
    force = float(left[:, 6:9].max()) * problem.mass_kg / problem.dt_s
    place = float(left[:, :6].max())
    solved = moment < _MOMENT_NM and force < _FORCE_N and place < _PLACE
    status = "solved" if solved else "(8) does not hold"
    motion = knots.gait, knots.body, knots.forces, knots.footholds
    return WalkSolution(*motion, knots.cost, iterations, status, solved, place, force)
