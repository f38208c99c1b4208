"""What `auto` tries where level bodies and centred grasps find no plan: another heading, then grasps off the middle.

Proofs that no plan exists come first where they are quick, and last where they need a search.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.build import build_problem
from crux_planner.errors import InfeasibleError
from crux_planner.problem import Problem
from crux_planner.proof.infeasible import Proof
from crux_planner.result import PlanResult
from crux_planner.search.balance import Balance
from crux_planner.search.stances import Move, Reach
from crux_planner.search.turning import Turning
from crux_planner.search.ways import Ways
from crux_planner.work import Culprit, Work

GREED = 1.5
ATTEMPTS = 8

Realise = Callable[
    [Scenario, Robot, Problem, Balance, Reach, Ways, list[Move], Work, float],
    PlanResult | tuple[InfeasibleError, Culprit],
]


PROOF_SHARE = 0.3  # of the time left, for the proofs that need a search
GOAL_PROOF_S = 2.0  # for the goal's equilibrium


def plan_wider(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    none_level: InfeasibleError,
    realise: Realise,
    work: Work,
    deadline: float,
) -> PlanResult:
    """A plan with other headings or off-centre grasps. Raises InfeasibleError, the level problem's if unproven."""
    proof = Proof(scenario, robot, problem)
    with work.part("proof", 0.1):
        impossible = proof.quick() or proof.goal_equilibrium(time.monotonic() + GOAL_PROOF_S)
    if impossible is not None:
        raise impossible
    until = time.monotonic() + (1.0 - PROOF_SHARE) * (deadline - time.monotonic())
    for off_centre in (False, True):
        with work.part("problem", 0.1):
            wide = build_problem(scenario, robot, off_centre=off_centre)
            reach, ways = Reach(wide), Ways(wide)
        balance = Balance(wide, wide.friction_share)
        for _ in range(ATTEMPTS):
            if time.monotonic() > until:
                break
            with work.part("headings", 0.2):
                turning = Turning(wide, reach, ways)
                moves, _ = turning.search(greed=GREED, deadline=until)
            if moves is None:
                break
            attempt = realise(scenario, robot, wide, balance, reach, ways, moves, work, deadline)
            if isinstance(attempt, PlanResult):
                return attempt
            culprit = attempt[1]
            work.log(f"wide {off_centre}: {attempt[0]}")
            if culprit is None:
                break
            ways.forbid(*culprit)
    with work.part("proof", 0.9):
        impossible = proof.disconnected(deadline)
    if impossible is None:
        raise none_level
    raise InfeasibleError(none_level.constraint, f"{none_level} (proven: {impossible})", proven=True)
