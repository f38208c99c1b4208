"""A plan without its waits: the knots left out at which all limbs hold on and the body hardly moves.

J (6) is of N knots, so that a sequence of contacts found for them waits where waiting costs least. Unless the scenario
says `planner.idle: keep`, what is solved and written is the same sequence over the knots in which something moves.
"""

from dataclasses import replace

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.problem import BodyBounds, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.trajectory.solution import Start
from crux_planner.trajectory.walk_qp import WalkKnots

PACES = (0.8, 0.25)  # of its largest speeds: a slower body waits; the second where the first gives no plan


def moving_knots(standing: Flags, body: Array, limits: BodyBounds, dt_s: float, pace: float) -> Indices:
    """The knots to keep of `standing` (N + 1,), all limbs on, and body states (N + 1, 6 or more).

    The body goes from one to the next no faster than at `pace`, or as before. All knots stay that a swing or a limb's
    load needs, and the first and the last two, at which the body rests.
    """
    last = len(standing) - 1
    inner = np.zeros(last + 1, dtype=bool)
    inner[2 : last - 1] = (standing[1:-1] & standing[:-2] & standing[2:])[1:-1]
    step = pace * dt_s * np.repeat([limits.max_speed_m_s, limits.max_rate_rad_s], 3)
    kept = [0]
    for k in range(1, last + 1):
        if not inner[k] or (np.abs(body[k + 1, :6] - body[kept[-1], :6]) > step).any():
            kept.append(k)
    return np.array(kept)


def states_at(kept: Indices, body: Array, dt_s: float) -> Array:
    """Body states (M, 12) at some of their knots, with the speeds that lead from one to the next."""
    states = body[kept]
    states[:-1, 6:] = np.diff(states[:, :6], axis=0) / dt_s
    return states


def without_waiting(problem: Problem, schedule: Schedule, start: Start, pace: float) -> tuple[Problem, Schedule, Start]:
    """The same moves over the knots in which something moves, and where to start solving them from."""
    standing = np.array([None not in knot for knot in schedule.contacts])
    kept = moving_knots(standing, start.body, problem.body, problem.dt_s, pace)
    if len(kept) == len(standing):
        return problem, schedule, start
    shorter = replace(
        schedule,
        contacts=[schedule.contacts[k] for k in kept],
        poses=schedule.poses[kept],
    )
    wrenches = [start.wrenches[k] for k in kept[:-1]]
    begun = replace(start, body=states_at(kept, start.body, problem.dt_s), wrenches=wrenches, near=True)
    return replace(problem, steps=len(kept) - 1), shorter, begun


def walk_without_waiting(problem: WalkProblem, knots: WalkKnots, pace: float) -> tuple[WalkProblem, WalkKnots]:
    """The same steps over the knots in which something moves, near their solution."""
    gait = knots.gait
    kept = moving_knots(np.asarray(gait.stance.all(axis=1)), knots.body, problem.body, problem.dt_s, pace)
    if len(kept) == gait.knots:
        return problem, knots
    place = {int(k): i for i, k in enumerate(kept)}
    steps = tuple(replace(step, lift=place[step.lift], land=place[step.land]) for step in gait.steps)
    shorter = replace(
        knots,
        gait=replace(gait, steps=steps, knots=len(kept)),
        body=states_at(kept, knots.body, problem.dt_s),
        forces=knots.forces[kept[:-1]],
    )
    return replace(problem, steps=len(kept) - 1), shorter
