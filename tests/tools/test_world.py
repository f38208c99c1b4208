"""The physics of a world that is not the plan, against statics and closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_tools.sim.climb import ClimbOptions, plant_of
from crux_tools.sim.plant import Plant
from crux_tools.sim.world_file import parse_world
from hand_plan import HALF_HOLD_M, MASS_KG, NOMINAL_M, PAD_HEIGHT_M, Wall, standing_plan
from holding_controller import HoldingController

SCALER = load_robot("scaler")
SETTLED_S = 4.0  # the hand is gone at 1.5 s


def in_world(text: str, plan: plan_t | None = None, seed: int = 3) -> Plant:
    """A plant on four holds h0..h3; `text`: sections of a world file."""
    plan = plan or standing_plan()
    world = parse_world(f"version: 1\nname: test\n{text}".encode()).draw(0, plan)
    return plant_of(plan, SCALER, ClimbOptions(seed=seed, world=world))


def carried_w(plant: Plant) -> Any:
    """(3,) Force of all holds on the robot, from the F/T sensors without their errors."""
    rotation = plant.data.site_xmat[plant.robot.gripper_sites].reshape(4, 3, 3)
    hands_kg = plant.model.body_subtreemass[plant.robot.gripper_bodies].sum()
    force = sum(rotation[limb] @ plant.ft_true[6 * limb : 6 * limb + 3] for limb in range(4))
    return force - hands_kg * plant.model.opt.gravity


def test_a_world_in_which_nothing_differs_is_the_plan_to_the_bit() -> None:
    plan = standing_plan()
    for text in ("", "holds: {all: {offset_m: [0, 0, 0]}}\nrobot: {joints: {all: {lag_s: 0}}, grippers: {all: {}}}\n"):
        plants = [in_world(text, plan), plant_of(plan, SCALER, ClimbOptions(seed=3))]
        for plant in plants:
            HoldingController(plant).run(1.0)
        first, second = ((p.data.qpos.tobytes(), p.data.qvel.tobytes(), p.ft.tobytes()) for p in plants)
        assert first == second


def test_a_payload_is_carried_and_moves_the_centre_of_mass() -> None:
    plant = in_world("robot: {payload: {mass_kg: 0.8, position_m: [0, 0.2, 0]}}\n")
    moved = plant.data.subtree_com[plant.robot.body] - in_world("").data.subtree_com[plant.robot.body]
    np.testing.assert_allclose(moved[:2], [0, 0.8 * 0.2 / (MASS_KG + 0.8)], atol=1e-6)
    HoldingController(plant).run(SETTLED_S)
    np.testing.assert_allclose(carried_w(plant), -(MASS_KG + 0.8) * Wall().gravity, atol=0.1)


def test_a_push_acts_from_its_beginning_to_its_end() -> None:
    plant = in_world(
        "pushes:\n  - {at_s: 3, for_s: 2, force_N: [0, 20, 0]}\n  - {at_s: 4, for_s: 1, force_N: [0, 0, 9]}\n"
    )
    control = HoldingController(plant)
    weight = -MASS_KG * Wall().gravity
    for until_s, push in ((2.9, [0, 0, 0]), (3.95, [0, 20, 0]), (4.95, [0, 20, 9]), (6.0, [0, 0, 0])):
        control.run(until_s - plant.time_s)
        np.testing.assert_allclose(carried_w(plant), weight - push, atol=0.3)


def test_a_hold_stands_where_the_world_has_it_and_the_robot_begins_on_it() -> None:
    wall = Wall(yaw_rad=np.array([0.3, 0.0, 0.0, 0.0]))
    plant = in_world(
        "holds: {h0: {offset_m: [0.01, 0, 0.002], yaw_deg: 5, size_change_m: [0.01, 0, 0]}}\n", standing_plan(wall)
    )
    body = plant.model.body("hold0")
    yaw = 0.3 + math.radians(5)
    place = [0.14 + 0.01 * math.cos(0.3), 0.36 + 0.01 * math.sin(0.3), 0.002]
    np.testing.assert_allclose(body.pos, place, atol=1e-12)
    np.testing.assert_allclose(body.quat, [math.cos(yaw / 2), 0, 0, math.sin(yaw / 2)], atol=1e-12)
    np.testing.assert_allclose(
        plant.data.site_xpos[plant.robot.gripper_sites[0]], place + np.array([0, 0, PAD_HEIGHT_M]), atol=1e-5
    )
    np.testing.assert_allclose(plant.finger_opening_m, [HALF_HOLD_M + 0.005, *[HALF_HOLD_M] * 3], atol=1e-9)
    np.testing.assert_allclose(plant.model.body("hold1").pos[:2], NOMINAL_M[1])
    HoldingController(plant).run(SETTLED_S)
    assert plant.limbs_on_holds().all()


def test_friction_and_spines_by_face() -> None:
    plant = in_world(
        "holds:\n  all: {friction_factor: 0.5}\n  h1: {friction: {+x: 0.4}, friction_factor: 1}\n"
        "  h2: {spines: false}\n"
    )
    found = {face.geom: (face.friction, face.spines) for face in plant.robot.faces}
    assert found["hold0"] == (1.1, True)
    assert found["hold1+x"] == (0.4, True)
    assert found["hold1-x"] == (2.2, True)
    assert found["hold2"] == (1.1, False)
    pairs = {
        plant.model.geom(plant.model.pair_geom2[i]).name: plant.model.pair_friction[i][0]
        for i in range(plant.model.npair)
    }
    assert pairs["hold0"] == 1.1
    assert pairs["hold1+x"] == 0.4


@pytest.mark.parametrize(
    ("change", "lost_s"),
    [("present: false", 0.0), ("breaks_at_s: 3", 3.0), ("breaks_at_N: 12", 0.5), ("breaks_at_N: 500", None)],
)
def test_a_hold_that_is_gone_touches_nothing(change: str, lost_s: float | None) -> None:
    plant = in_world(f"holds: {{h3: {{{change}}}}}\n")
    control = HoldingController(plant)
    gone_s = None
    for _ in range(round(SETTLED_S / plant.dt_s)):
        control.run(plant.dt_s)
        if gone_s is None and plant.time_s > 0.5 and plant.pad_face[6:].max() < 0:
            gone_s = plant.time_s
    assert plant.limbs_on_holds().tolist()[:3] == [True] * 3
    if lost_s is None:
        assert gone_s is None
    else:
        assert gone_s is not None
        assert max(lost_s, 0.5) <= gone_s <= max(lost_s, 0.5) + 1.0


def test_a_hold_bears_the_net_force_of_its_contacts_and_not_the_squeeze() -> None:
    """20 N a finger and 3 N of load: a hold that breaks at 40 N stays, though its contacts have 40 N and more."""
    plant = in_world("holds: {all: {breaks_at_N: 39}}\n")
    HoldingController(plant, squeeze_n=25.0).run(SETTLED_S)
    assert plant.pad_force_n.reshape(4, 2).sum(axis=1).min() > 39
    assert plant.limbs_on_holds().all()
