"""One pad, pulled and twisted on a face of a hold, slips where equation (2) says; spines add their shear."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_simulation.benchmarks.table3 import FRICTION, planned_N
from crux_simulation.sim.pad_rig import box_face, pad_on_face, slips_within
from crux_tools.robot3d.wall import add_wall
from hand_plan import HALF_HOLD_M, PAD_HEIGHT_M, Wall, standing_plan

MU = 2.2
PATCH_K_M = 2 / 3 * 0.02
NORMAL_N = 15.0
SPINE_N = 5.0
SETTLE_S, RAMP_S = 0.5, 3.0
SHARES = (0.8, 1.2)  # of what is allowed, ramped through so slowly that inertia hides little of the slip
MOVED_M, TURNED_RAD = 0.0005, 0.005


def on_the_first_hold(spines: bool, mixed_faces: bool) -> mujoco.MjModel:
    """The pad on the +x face of the first hold."""
    friction = (MU, MU, 0.1, 0.1, MU) if mixed_faces else (MU,) * 5
    plan = standing_plan(Wall(friction=friction, spines=(int(spines),) * 5))
    radius_m = load_robot("scaler").gripper.pad_radius_m
    x, y, _ = plan.holds[0].position_w_m
    at_W_m = [x + HALF_HOLD_M + radius_m, y, PAD_HEIGHT_M]
    return pad_on_face(lambda spec: add_wall(spec, plan), at_W_m, radius_m, PATCH_K_M, SPINE_N if spines else 0.0)


def share_at_slip(
    shear_n: tuple[float, float], twist_nm: float, normal_n: float = NORMAL_N, spines: bool = False, mixed: bool = False
) -> float:
    """Ramps the load; returns it at slip as a share of what (2) and the spines allow."""
    model = on_the_first_hold(spines, mixed)
    data = mujoco.MjData(model)
    if spines:
        data.ctrl[0] = 1 / MU
    capacity_n = MU * normal_n + (SPINE_N if spines else 0.0)
    allowed = capacity_n / np.sqrt(shear_n[0] ** 2 + shear_n[1] ** 2 + (twist_nm / PATCH_K_M) ** 2)
    load = np.array([0.0, *shear_n, twist_nm])
    press = np.array([-normal_n, 0.0, 0.0, 0.0])
    settling = round(SETTLE_S / model.opt.timestep)
    for step in range(settling):
        share = SHARES[0] * step / settling
        data.qfrc_applied[:] = press + share * allowed * load
        data.qfrc_applied[0] -= 1.0 - step / settling  # a nudge, so that spines without normal load find the face
        mujoco.mj_step(model, data)
    start = data.qpos.copy()
    steps = round(RAMP_S / model.opt.timestep)
    for step in range(steps):
        share = SHARES[0] + (SHARES[1] - SHARES[0]) * step / steps
        data.qfrc_applied[:] = press + share * allowed * load
        mujoco.mj_step(model, data)
        moved = data.qpos - start
        if np.hypot(moved[1], moved[2]) > MOVED_M or abs(moved[3]) > TURNED_RAD:
            return float(share)
    return float("inf")


@pytest.mark.parametrize(
    ("shear_n", "twist_nm"),
    [((1, 0), 0.0), ((0, 1), 0.0), ((0.7, 0.7), 0.0), ((0, 0), 0.01), ((9, 0), 0.15), ((9, 5), 0.1), ((9, 0), 0.3)],
)
def test_pad_slips_on_the_limit_surface(shear_n: tuple[float, float], twist_nm: float) -> None:
    assert share_at_slip(shear_n, twist_nm) == pytest.approx(1.0, abs=0.05)


def test_faces_of_their_own_friction_keep_the_limit_surface() -> None:
    assert share_at_slip((9, 5), 0.1, mixed=True) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("normal_n", [0.0, 10.0])
def test_spines_add_their_shear_with_and_without_normal_force(normal_n: float) -> None:
    assert share_at_slip((1, 0), 0.0, normal_n, spines=True) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("twist_nm", [0.0, 0.3, 0.6])
def test_what_is_planned_with_the_patch_constraint_holds_and_what_coulomb_allows_does_not(twist_nm: float) -> None:
    radius_m = load_robot("scaler").gripper.pad_radius_m
    held_n = np.hypot(9.0, twist_nm / PATCH_K_M) / FRICTION  # by (2)
    planned_n = planned_N(9.0, twist_nm, with_patch=True)
    assert 1.0 < planned_n / held_n < 1.5

    def slips(normal_n: float, friction: float) -> bool:
        model = pad_on_face(lambda spec: box_face(spec, friction), [0.03 + radius_m, 0, 0], radius_m, PATCH_K_M)
        return slips_within(model, normal_n, 9.0, twist_nm)

    share = held_n / planned_n  # of the friction planned with, at which it slips
    assert not slips(planned_n, 1.05 * share * FRICTION)
    assert slips(planned_n, 0.95 * share * FRICTION)
    assert slips(planned_N(9.0, twist_nm, with_patch=False), 0.95 * FRICTION)
    assert slips(planned_N(9.0, twist_nm, with_patch=False), 1.05 * FRICTION) == (twist_nm > 0.0)
