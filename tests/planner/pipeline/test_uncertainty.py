"""Plans for what the scenario does not know: they hold in drawn worlds in which the usual plan does not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_planner.checker import check_plan
from crux_tools.paths import SCENARIOS
from scipy.spatial.transform import Rotation
from shared_plans import unproven
from turned import turned
from walls import one_move, scenario

KNOWN = {"friction": 0.2, "hold_position_m": 0.005, "hold_yaw_deg": 3.0, "mass_kg": 1.0, "centre_of_mass_m": 0.02}
SPINES = (5.0, 5.0, 0.05)  # N, N, N m of a finger, as walls.py has them
REACH = ("joint_position", "inverse_kinematics")
DRAWS = 20
BETWEEN_N = 0.3  # the check looks between the knots, where the body is a little further


def wall(**more: Any) -> dict[str, Any]:
    return {**one_move(), **more}


def excess_N(plan: Any, robot: Robot, draws: int) -> float:
    """The most by which a finger leaves its limit surface in worlds at random corners, at the plan's own knots.

    Own arithmetic: the centre of mass is where the plan's wrenches balance; what another mass, and forces elsewhere,
    ask for is shared by the least change of forces and twists.
    """
    random, length, worst = np.random.default_rng(7), robot.control.twist_length_m, -np.inf
    for knot in plan.knots[:-1]:
        held = [limb for limb in knot.limbs if limb.hold >= 0]
        place = np.array([limb.gripper_position_w_m for limb in held])
        fingers = np.array([limb.finger_force_w_n for limb in held]).reshape(-1, 2, 3)
        moment = np.array([limb.finger_moment_w_nm for limb in held]).reshape(-1, 2, 3).sum(axis=1)
        yaw = np.array([limb.gripper_yaw_w_rad for limb in held])
        tilt = Rotation.from_rotvec([[*limb.gripper_tilt_w_rad, 0.0] for limb in held])
        axis = tilt.apply(np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1))
        force = fingers.sum(axis=1)
        total, about = force.sum(axis=0), (np.cross(place, force) + moment).sum(axis=0)
        centre = np.cross(total, about) / (total @ total)  # up to a part along the force, which turns nothing
        normals = np.einsum("lfi,li,f->lf", fingers, axis, [1.0, -1.0])
        for _ in range(draws):
            mass, aside = 1.0 + random.choice([-1, 1]) / robot.total_mass_kg, random.choice([-1, 1], 3) * 0.02
            off = np.append(random.choice([-1, 1], (len(held), 2)) * 0.005, np.zeros((len(held), 1)), axis=1)
            moved = place + tilt.apply(off)
            wanted = np.append(mass * total, np.cross(centre + aside, mass * total))
            lack = wanted - np.append(total, (np.cross(moved, force) + moment).sum(axis=0))
            columns = np.concatenate(
                [
                    np.array(
                        [*(np.append(e, np.cross(at, e)) for e in np.eye(3)), np.append(np.zeros(3), length * out)]
                    )
                    for at, out in zip(moved, axis, strict=True)
                ]
            )
            change = np.linalg.lstsq(columns.T, lack, rcond=None)[0].reshape(-1, 4)
            there = yaw + np.radians(3.0) * random.choice([-1, 1], len(held))
            out = tilt.apply(np.stack([np.cos(there), np.sin(there), 0 * there], axis=1))
            up = tilt.apply(np.tile([0.0, 0.0, 1.0], (len(held), 1)))
            now = force + change[:, :3]
            twist = ((moment + length * change[:, 3:] * axis) * out).sum(axis=1)
            shear = [(now * way).sum(axis=1) for way in (np.cross(up, out), up)]
            load = np.abs(0.5 * np.stack([*shear, twist], axis=1))
            rest = np.maximum(load - SPINES, 0.0) / [1.0, 1.0, plan.patch_k_m]
            pull = (now * out).sum(axis=1) - (force * axis).sum(axis=1)
            for normal in (normals[:, 0] + pull / 2, normals[:, 1] - pull / 2):
                worst = max(worst, float((np.linalg.norm(rest, axis=1) - 0.8 * 2.2 * normal).max()))
    return worst


@pytest.mark.parametrize("given", [wall(), turned()], ids=["upright", "turned"])
def test_a_plan_for_the_uncertain_holds_where_the_usual_one_does_not(given: dict[str, Any], robot: Robot) -> None:
    as_many = {"planner": {"idle": "keep"}}  # steps, so that costs compare
    usual, sure = (unproven(scenario({**given, **more, **as_many}), robot) for more in ({}, {"uncertainty": KNOWN}))
    assert sure.check.ok
    assert excess_N(sure.plan, robot, DRAWS) < BETWEEN_N
    assert excess_N(usual.plan, robot, DRAWS) > 1.0
    assert sure.nominal_cost is not None
    assert usual.nominal_cost is None
    assert sure.nominal_cost == pytest.approx(usual.cost, rel=0.02)
    assert sure.cost > 1.1 * sure.nominal_cost

    usual.plan.scenario_yaml, usual.plan.scenario_sha256 = sure.plan.scenario_yaml, sure.plan.scenario_sha256
    refused = {violation.constraint for violation in check_plan(usual.plan, robot).violations}
    assert "limit_surface_uncertain" in refused


def test_limbs_reach_a_far_hold_wherever_it_is(robot: Robot) -> None:
    far = wall()
    far["holds"][4]["position_m"] = [0.05, 0.47]  # beyond the boxes of LF's reach
    usual, sure = (unproven(scenario({**far, **more}), robot) for more in ({}, {"uncertainty": KNOWN}))
    assert sure.check.ok
    usual.plan.scenario_yaml, usual.plan.scenario_sha256 = sure.plan.scenario_yaml, sure.plan.scenario_sha256
    beyond = {each.limb for each in check_plan(usual.plan, robot).violations if each.constraint.startswith(REACH)}
    assert beyond == {"LF"}


def test_the_least_friction_takes_no_strength_from_the_fingers(robot: Robot) -> None:
    text = (SCENARIOS / "climb-one-step.yaml").read_text(encoding="utf-8")
    known = "{friction: 0.4, hold_position_m: 0.01, hold_yaw_deg: 6, mass_kg: 1, centre_of_mass_m: 0.01}"
    plan = unproven(parse_scenario(f"{text}\nuncertainty: {known}\n"), robot).plan
    stance = [limb for knot in plan.knots for limb in knot.limbs if limb.hold >= 0]
    assert {round(limb.friction, 6) for limb in stance} == {1.32}
    stance[0].friction = 2.2
    assert "friction" in {violation.constraint for violation in check_plan(plan, robot).violations}


def test_numbers_given_as_sigmas_count_so_many_times() -> None:
    known = scenario(wall(uncertainty={"friction": 0.1, "hold_yaw_deg": 2.0, "sigmas": 3})).uncertainty
    assert known is not None
    assert known.friction == pytest.approx(0.3)
    assert known.hold_yaw_rad == pytest.approx(np.radians(6.0))
    assert known.mass_kg == 0.0


@pytest.mark.parametrize(
    ("known", "said"),
    [
        ({"friction": 1.2}, r"uncertainty\.friction.*1\.2.*0\.95"),
        ({"friction": 0.5, "sigmas": 3}, r"uncertainty\.friction.*0\.5"),
        ({"mas_kg": 1.0}, "mas_kg"),
    ],
)
def test_what_is_wrong_with_it_is_said(known: dict[str, float], said: str) -> None:
    with pytest.raises(ScenarioError, match=said):
        scenario(wall(uncertainty=known))


def test_walks_have_none() -> None:
    text = (SCENARIOS / "walk-flat.yaml").read_text(encoding="utf-8") + "\nuncertainty: {friction: 0.1}\n"
    with pytest.raises(ScenarioError, match=r"uncertainty.*point"):
        parse_scenario(text)
