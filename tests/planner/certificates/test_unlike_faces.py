"""Holds whose opposite faces differ: plans for them are found, not denied, and cost no less than the bound."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario
from crux_msgs import plan_t
from crux_planner import Planner
from crux_planner.certificates.bound.climb import lower_bound
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.checker import check_plan
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.pipeline.message import plan_header
from crux_planner.solvers import clock
from shared_plans import unproven
from walls import scenario, two_rows

ROBOT = load_robot("scaler")
USED, LESS_USED = 0.85, 0.7  # of the limit surface, by the most loaded finger on each face


def demand(limb: Any, k_m: float) -> tuple[Array, Array]:
    """Normal forces (2,) of the fingers of a gripper in stance, and the friction (2,) that their loads ask for."""
    force, moment = np.reshape(limb.finger_force_w_n, (2, 3)), np.reshape(limb.finger_moment_w_nm, (2, 3))
    axis = np.array([np.cos(limb.gripper_yaw_w_rad), np.sin(limb.gripper_yaw_w_rad), 0.0])
    normal = (force @ axis) * [1.0, -1.0]
    along = force - (force @ axis)[:, None] * axis
    return normal, np.hypot(np.linalg.norm(along, axis=1), (moment @ axis) / k_m) / normal


@lru_cache
def even_wall(seed: int) -> tuple[dict[str, Any], bytes]:
    """A wall whose faces are alike, and a plan for it."""
    random = np.random.default_rng(seed)
    wall = two_rows(0.15, slope_deg=float(random.uniform(42.0, 50.0)))
    wall["contact"].update(spine_shear_N=0, spine_twist_Nm=0, max_normal_N=37)
    for part in wall["holds"]:
        part["position_m"] = [round(c + random.uniform(-0.005, 0.005), 4) for c in part["position_m"]]
        part["size_m"] = [0.06, 0.042, 0.06]
    return wall, unproven(scenario(wall), ROBOT).plan.encode()


@lru_cache
def wall_and_plan(seed: int, used: float = USED) -> tuple[Scenario, Any]:
    """A wall on which every face has the friction that one plan needs of it, and that plan."""
    wall, encoded = even_wall(seed)
    wall, even = deepcopy(wall), plan_t.decode(encoded)
    friction = np.zeros((len(wall["holds"]), 5))
    for knot in even.knots:
        for limb in knot.limbs:
            if limb.hold >= 0:
                faces = [limb.finger1_face, limb.finger1_face ^ 1]
                needed = demand(limb, even.patch_k_m)[1] / used
                friction[limb.hold, faces] = np.maximum(friction[limb.hold, faces], needed)
    for part, of_faces in zip(wall["holds"], friction, strict=True):
        part["friction"] = dict(zip(("+x", "-x", "+y", "-y", "top"), map(float, of_faces), strict=True))
    read = scenario(wall)
    plan = plan_header(read, ROBOT, even.cost)
    for name in ("patch_k_m", "max_normal_n", "spine_shear_n", "spine_twist_nm", "knots", "n_knots"):
        setattr(plan, name, getattr(even, name))
    for knot in plan.knots:
        for limb in knot.limbs:
            if limb.hold >= 0:
                limb.friction = float(friction[limb.hold, [limb.finger1_face, limb.finger1_face ^ 1]].min())
    plan.plan_id = plan_id(plan)
    return read, plan


SEEDS = pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (1, 2))])


@SEEDS
@pytest.mark.parametrize("budget_s", [1.0, pytest.param(20.0, marks=pytest.mark.sweep)])
def test_no_proof_denies_a_plan_that_presses_its_better_faces(seed: int, budget_s: float) -> None:
    read, known = wall_and_plan(seed)
    assert check_plan(known, ROBOT).ok
    proof, until = Proof(read, ROBOT, build_problem(read, ROBOT)), clock.now() + budget_s
    assert (proof.quick() or proof.goal_equilibrium(10**6, until) or proof.disconnected(10**6, until)) is None


@SEEDS
def test_no_bound_is_above_a_plan_that_presses_its_better_faces(seed: int) -> None:
    read, known = wall_and_plan(seed)
    bound = lower_bound(replace(build_problem(read, ROBOT), steps=known.n_knots - 1), 1.1 * known.cost)
    assert bound is not None
    assert bound <= known.cost


@SEEDS
def test_the_planner_finds_a_plan_that_presses_the_better_faces(seed: int) -> None:
    read, _ = wall_and_plan(seed, LESS_USED)
    found = Planner(read, ROBOT).plan()
    assert check_plan(found.plan, ROBOT).ok
    lesser = [
        demand(limb, found.plan.patch_k_m)[1].max() > limb.friction
        for knot in found.plan.knots
        for limb in knot.limbs
        if limb.hold >= 0
    ]
    assert any(lesser)  # a finger bears more than it could on the other face


@pytest.mark.sweep
def test_a_finger_hangs_on_by_its_spines_where_the_other_has_friction() -> None:
    wall = two_rows()
    wall["contact"].update(spine_shear_N=25, spine_twist_Nm=0.5)
    for part in wall["holds"]:
        part["friction"] = {"+x": 0.05, "-x": 2.2, "+y": 0.0, "-y": 0.0, "top": 0.0}
        part["spines"] = {"+x": True, "-x": False}
    assert check_plan(Planner(scenario(wall), ROBOT).plan().plan, ROBOT).ok
