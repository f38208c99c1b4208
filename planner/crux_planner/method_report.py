"""Parts of the planner by themselves, for whoever measures them: the paper's methods without what follows them.

What the functions need is imported when they are called: the thresholds alone cost nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import Scenario, ScenarioError

from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import FORCE_THRESHOLD_N, POSITION_THRESHOLD_M

if TYPE_CHECKING:
    from crux_planner.admm.admm import Decided
    from crux_planner.checker import CheckReport
    from crux_planner.pipeline.first_wall import FirstWall
    from crux_planner.pipeline.wall_check import StartStance, WallReport
    from crux_planner.reach.upright import UprightReach
    from crux_planner.search.highest import Highest
    from crux_planner.trajectory.knot_qp import KnotSolution

__all__ = [
    "FORCE_THRESHOLD_N",
    "METHODS_HERE",
    "POSITION_THRESHOLD_M",
    "FirstWall",
    "Highest",
    "MethodReport",
    "StartStance",
    "UprightReach",
    "WallReport",
    "climb_report",
    "first_walls",
    "least_normal_N",
    "limits",
    "start_is_well_formed",
    "upright_reach",
    "walk_residuals",
    "wall_lacks",
    "wall_offers",
    "wall_report",
    "wall_stances",
    "way_up",
]

LIMIT_S = 300.0
METHODS_HERE = """how the paper's methods are implemented:
  two_block    equation (19): a MIP without (8b) for contacts and an NLP with it, from a cold start; squares are
               tangents, since HiGHS solves no quadratic MIP; contacts change only between windows of some knots
  multi_block  P3: one such MIP for each limb, without the body, an NLP, projection and duals; the consensus includes
               who is in the air, and limbs take turns
  benchmark    P1 as one NLP whose binaries are driven towards 0 and 1, as in the paper
  all of them end with auto's exact NLP and check, so their times do not compare with the paper's"""


def limits() -> dict[str, float]:
    """What bounds the paper's methods: seconds of computing of a run and of one MIP, gaps, rho, iterations."""
    from crux_planner.admm import contact_block, limbs, methods, walk_mip

    return {
        "seconds a run of a figure": LIMIT_S,
        "seconds a MIP": contact_block.MILP_TIME_S,
        "seconds a limb's MIP": limbs.TIME_S,
        "gap of a climb's MIP": contact_block.MILP_GAP,
        "gap of a walk's MIP": walk_mip.GAP,
        "rho of two_block": methods.RHO,
        "rho of multi_block": methods.MULTI_RHO,
        "iterations of two_block": methods.ITERATIONS,
        "iterations of multi_block": methods.MULTI_ITERATIONS,
    }


@dataclass(frozen=True)
class MethodReport:
    """What a method reached before the exact NLP, as a plan, and the checker's verdict on it."""

    decided: Decided[KnotSolution]
    plan: Any  # crux_msgs.plan_t
    check: CheckReport


def climb_report(scenario: Scenario, method: str, **settings: Any) -> MethodReport:
    """Run `method` on a climb; `settings` as `crux_planner.admm.methods.Task` has them. Raises InfeasibleError."""
    from crux_planner.admm.methods import METHODS, Task
    from crux_planner.admm.windows import Windows
    from crux_planner.checker import check_plan
    from crux_planner.model.build import build_problem
    from crux_planner.physics.reachable_set import ReachableSet
    from crux_planner.pipeline.message import plan_message
    from crux_planner.swing.swing_cache import SwingCache

    robot = load_robot(scenario.robot)
    problem = build_problem(scenario, robot)
    windows = Windows(problem, ReachableSet(problem), SwingCache(problem))
    task = Task(windows, deadline=clock.now() + LIMIT_S, **settings)
    decided = METHODS[method](task)
    knots = decided.knots
    plan = plan_message(scenario, robot, problem, knots.schedule, knots.solution, method)
    return MethodReport(decided, plan, check_plan(plan, robot))


def walk_residuals(scenario: Scenario, method: str, **settings: Any) -> list[dict[str, float]]:
    """What `method` leaves between its blocks after each iteration of a walk; `settings` as WalkTask has them."""
    from crux_planner.admm.methods import METHODS, WalkTask
    from crux_planner.model.walk_problem import build_walk

    problem = build_walk(scenario, load_robot(scenario.robot))
    return METHODS[method](WalkTask(problem=problem, deadline=clock.now() + LIMIT_S, **settings)).history


def least_normal_N(shear_N: float, twist_Nm: float, friction: float, patch_k_m: float, most_N: float) -> float:
    """The least normal force with which a climb's rows of the limit surface (2) let one finger bear a load."""
    from scipy.optimize import linprog

    from crux_planner.model.build import FRICTION_MARGIN
    from crux_planner.physics.limit_surface import FingerLimit, grip_rows, polytope_directions

    limit = FingerLimit(0, (1.0 - FRICTION_MARGIN) * friction, np.zeros(3))
    rows, right = grip_rows([limit], *polytope_directions(patch_k_m), np.full(2, most_N))
    load = (shear_N, 0.0, twist_Nm, 0.0)  # s1, s2, m, F; what is left is n
    found = linprog([0, 0, 0, 0, 1], rows, right, bounds=[*((x, x) for x in load), (0.0, None)])
    if not found.success:
        raise RuntimeError(f"linprog finds no normal force: {found.message}")
    return float(found.x[4])


def start_is_well_formed(scenario: Scenario) -> bool:
    """Whether a scenario of a climb would be planned at all, or found infeasible, and not be refused as wrong."""
    from crux_planner.errors import InfeasibleError
    from crux_planner.model.build import build_problem
    from crux_planner.pipeline.explanation import check_clear, check_start
    from crux_planner.search.equilibrium import StaticEquilibrium

    try:
        robot = load_robot(scenario.robot)
        problem = build_problem(scenario, robot)
        check_clear(scenario, problem, robot)
        check_start(scenario, problem, StaticEquilibrium(problem, problem.friction_share))
    except ScenarioError:
        return False
    except InfeasibleError:
        return True
    return True


def wall_report(
    scenario: Scenario, robot: Robot, limit_s: float, looks: int, at: Callable[[float], None]
) -> WallReport:
    """What a wall offers a robot: see `crux_planner.pipeline.wall_check`."""
    from crux_planner.pipeline import wall_check

    return wall_check.wall_report(scenario, robot, limit_s, looks, at)


def wall_offers(scenario: Scenario, robot: Robot) -> WallReport:
    """The same without the search for the way up: see `crux_planner.pipeline.wall_check`."""
    from crux_planner.pipeline import wall_check

    return wall_check.wall_offers(scenario, robot)


def wall_stances(scenario: Scenario, robot: Robot) -> list[StartStance]:
    """The stances of a wall alone: see `crux_planner.pipeline.wall_check`."""
    from crux_planner.pipeline import wall_check

    return wall_check.wall_stances(scenario, robot)


def way_up(scenario: Scenario, robot: Robot, limit_s: float, looks: int) -> tuple[Highest, StartStance | None]:
    """How far up one gets from a scenario's start: see `crux_planner.pipeline.wall_check`."""
    from crux_planner.pipeline import wall_check

    return wall_check.way_up(scenario, robot, limit_s, looks)


def wall_lacks(scenario: Scenario, robot: Robot) -> dict[tuple[int, str], str]:
    """By number of a hold and pair of its faces, x or y, why no gripper takes it, wherever the body is."""
    from crux_planner.model.build import wall_contacts
    from crux_planner.model.contacts import PAIR_NAMES

    return {(hold, PAIR_NAMES[pair]): why for (hold, pair), why in wall_contacts(scenario, robot, True)[1].items()}


def first_walls(robot: Robot) -> Iterator[FirstWall]:
    """Walls for a robot's first climb: see `crux_planner.pipeline.first_wall`."""
    from crux_planner.pipeline import first_wall

    return first_wall.first_walls(robot)


def upright_reach(robot: Robot, limb: int) -> UprightReach:
    """Where a limb can have its gripper beside the body: see `crux_planner.reach.upright`."""
    from crux_planner.reach import upright

    return upright.upright_reach(robot, limb)
