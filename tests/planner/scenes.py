"""Problems for the tests of the ADMM methods."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.admm.windows import Windows
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.solvers import clock
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.consensus import Eta, Scales

FEET = {"LF": (0.14, 0.36), "RF": (0.14, -0.36), "LR": (-0.14, 0.36), "RR": (-0.14, -0.36)}


@dataclass(frozen=True)
class Scene:
    """A problem with what the methods need of it."""

    problem: Problem
    equilibrium: StaticEquilibrium
    reach: ReachableSet
    swings: SwingCache
    windows: Windows

    @property
    def later(self) -> float:
        """A deadline far enough."""
        return clock.now() + 60.0


def wall(steps: int, *, width_m: float = 0.06, goal_m: float = 0.15) -> str:
    """Four holds and four 0.15 m above; `width_m` across decides whether the side faces can be gripped too."""
    holds: list[str] = []
    for limb, (x, y) in FEET.items():
        for name, along in ((f"{limb}-low", x), (f"{limb}-high", x + 0.15)):
            size = f"[0.06, {width_m}, 0.06]"
            holds.append(f"  - {{name: {name}, position_m: [{along}, {y}], size_m: {size}, friction: 2.2}}")
    grasps = ", ".join(f"{limb}: {{hold: {limb}-low, faces: x}}" for limb in FEET)
    return "\n".join(
        [
            "version: 1",
            "name: small-wall",
            "robot: scaler",
            "wall: {slope_deg: 45}",
            "contact: {model: patch, max_normal_N: 60, spine_shear_N: 5, spine_twist_Nm: 0.05}",
            "holds:",
            *holds,
            f"start: {{body: {{position_m: [0.0, 0.0, 0.185]}}, grasps: {{{grasps}}}}}",
            f"goal: {{body: {{position_m: [{goal_m}, 0.0, 0.185]}}}}",
            f"horizon: {{steps: {steps}, dt_s: 2.0}}",
        ]
    )


def square(eta: Eta, scales: Scales) -> float:
    """|eta|^2 in the consensus norm."""
    parts = [
        *((eta.body[:, :3], scales.position), (eta.body[:, 3:6], scales.orientation), (eta.body[:, 6:], scales.rate)),
        *((eta.fingers, scales.position), (eta.yaws, scales.orientation)),
        *((eta.forces, scales.force), (eta.moments, scales.moment), (eta.away, scales.flag)),
    ]
    return float(sum(unit**2 * (values**2).sum() for values, unit in parts))


@lru_cache
def scene(steps: int = 40, **how: Any) -> Scene:
    """The problem of `wall`."""
    problem = build_problem(parse_scenario(wall(steps, **how)), load_robot("scaler"))
    equilibrium, reach, swings = (
        StaticEquilibrium(problem, problem.friction_share),
        ReachableSet(problem),
        SwingCache(problem),
    )
    return Scene(problem, equilibrium, reach, swings, Windows(problem, reach, swings))
