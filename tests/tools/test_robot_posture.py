"""Links that meet and torques of joints, at any posture, against MuJoCo's own geometry, Jacobians and gravity."""

from __future__ import annotations

import shutil
from functools import cache
from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np
import pytest
from crux_contracts.robot import ROBOTS, load_robot
from crux_tools.robot.described import Described, described
from crux_tools.robot.loads import PATCH_K_M, gravity_b_m_s2, joint_loads, least_load
from crux_tools.robot.stance import CLEAR_M, LimbReach, Stance, closest, limb_reach, meetings, stance, standing
from crux_tools.robot3d.robot_model import urdf_spec

OPENING_M, FRICTION, MOST_N = 0.03, 2.2, 60.0


@cache
def by_mujoco() -> mujoco.MjModel:
    """The shipped robot, its body fixed."""
    spec = urdf_spec(load_robot(ROBOTS / "scaler"))
    for geom in spec.geoms:  # cylinders as crux has them
        if geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE
            geom.size = [geom.size[0], max(geom.size[1] - geom.size[0], 1e-9), 0]
    return spec.compile()


@cache
def the_robot() -> Described:
    return described("scaler")


def at(q_rad: np.ndarray, slope_rad: float = 0.0) -> tuple[Stance, mujoco.MjData]:
    """Of angles (4, 6), by crux and by MuJoCo."""
    robot = the_robot()
    assert robot.model is not None
    model = by_mujoco()
    data = mujoco.MjData(model)
    for limb, q in zip(robot.model.limbs, q_rad, strict=True):
        for joint, angle in zip(limb.joints, q, strict=True):
            data.joint(joint.name).qpos = angle
        for finger in limb.fingers:
            data.joint(finger.name).qpos = OPENING_M
    model.opt.gravity = gravity_b_m_s2(slope_rad)
    mujoco.mj_forward(model, data)
    return standing(robot.model, list(q_rad), OPENING_M), data


def limb_of(link: str) -> str:
    return link[:2] if link[2:3] == "_" else "body"


def test_links_that_meet_are_those_that_mujoco_finds() -> None:
    robot, model, rng = the_robot(), by_mujoco(), np.random.default_rng(3)
    assert robot.model is not None
    on_body = {name for limb in robot.model.limbs for name in limb.on_body}
    geoms = [(model.body(model.geom_bodyid[i]).name, i) for i in range(model.ngeom)]
    most = 0
    for _ in range(12):
        q = np.array([rng.uniform(limb.lower_rad, limb.upper_rad) for limb in robot.model.limbs])
        where, data = at(q)
        found: dict[frozenset[str], float] = {}
        for (one, i), (other, j) in combinations(geoms, 2):
            limbs = {limb_of(one), limb_of(other)}
            if len(limbs) == 1 or ("body" in limbs and {one, other} & on_body):
                continue
            gap = mujoco.mj_geomDistance(model, data, i, j, 0.05, None)
            links = frozenset((one, other))
            found[links] = min(gap, found.get(links, 1.0))
        told = {frozenset(each.links): each.gap_m for each in meetings(where, CLEAR_M)}
        doubtful = {links for links, gap in found.items() if abs(gap - CLEAR_M) < 1e-4}
        assert {links for links, gap in found.items() if gap < CLEAR_M} - doubtful == set(told) - doubtful
        for links, gap in told.items():
            assert gap == pytest.approx(found[links], abs=1e-4) or found[links] < 0 > gap
        most = max(most, len(told))
    assert most > 0


@pytest.mark.parametrize("slope_deg", [0, 60, 120])
@pytest.mark.parametrize("lifted", [None, 1])
def test_grips_carry_the_robot_and_joints_bear_what_mujoco_says(slope_deg: float, lifted: int | None) -> None:
    """Also where a gripper is turned off the wall's normal."""
    robot, model = the_robot(), by_mujoco()
    assert robot.model is not None
    limbs, slope = robot.model.limbs, np.radians(slope_deg)
    q = np.array(stance(robot.model, reaches(robot), OPENING_M).q_rad)
    q[:, 3:] += 0.2
    where, data = at(q, slope)
    peaks = [np.array([joint.effort for joint in limb.joints]) for limb in limbs]
    found = joint_loads(where, slope, peaks, FRICTION, MOST_N, lifted)
    least = least_load(where, slope, peaks, FRICTION, MOST_N, lifted)
    assert found is not None
    assert least is not None
    assert max(np.abs(share).max() for share in found.shares) == pytest.approx(least.share, rel=1e-6)
    total = np.concatenate([model.body_mass.sum() * model.opt.gravity, np.zeros(3)])
    total[3:] = np.cross(data.subtree_com[0], total[:3])
    for i, limb in enumerate(limbs):
        body = model.body(limb.gripper).id
        place, turn = data.xpos[body], data.xmat[body].reshape(3, 3)
        force, moment = found.wrenches[i, :3], found.wrenches[i, 3:]
        total += np.concatenate([force, np.cross(place, force) + moment])
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], body)
        torque = data.qfrc_bias - jacobian.T @ found.wrenches[i]
        dofs = [model.joint(joint.name).dofadr[0] for joint in limb.joints]
        assert found.shares[i] == pytest.approx(torque[dofs] / peaks[i], abs=1e-6)
        along, shear_y, shear_z = turn.T @ force
        one, other = found.pressures_N[i]
        assert along == pytest.approx(one - other, abs=1e-6)
        used = abs(shear_y / 2) / FRICTION + abs(shear_z / 2) / FRICTION
        used += abs(turn[:, 0] @ moment / 2) / (PATCH_K_M * FRICTION)
        assert used <= min(one, other) + 1e-6
        assert 0 <= max(one, other) <= MOST_N + 1e-6
        if i == lifted:
            assert not found.wrenches[i].any()
    assert total == pytest.approx(np.zeros(6), abs=1e-6)


def reaches(robot: Described) -> list[LimbReach]:
    assert robot.model is not None
    return [limb_reach(robot.model.body, limb, robot.sections) for limb in robot.model.limbs]


def changed(folder: Path, *changes: tuple[str, str]) -> Described:
    """The shipped robot with other words in its URDF."""
    shutil.copytree(ROBOTS / "scaler", folder / "robot")
    path = folder / "robot" / "scaler.urdf"
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return described(str(folder / "robot"))


def test_a_limb_behind_a_fixed_joint_reaches_what_it_did(tmp_path: Path) -> None:
    """Also where that joint is on the body's other side."""
    plate = """<joint name="LF_seam" type="fixed"><parent link="base"/><child link="LF_plate"/>
        <origin xyz="0.1355 -0.05 0"/></joint><link name="LF_plate"/>"""
    first = """<joint name="LF_joint1" type="revolute">
    <parent link="{}"/>
    <child link="LF_link1"/>
    <origin xyz="{} 0" """
    behind = changed(tmp_path, (first.format("base", "0.1355 0.144"), plate + first.format("LF_plate", "0 0.194")))
    one, other = reaches(behind)[0], reaches(the_robot())[0]
    assert one.area_m2 == other.area_m2 > 0.1
    assert one.yaw_rad == other.yaw_rad


def test_reach_keeps_links_off_the_body(tmp_path: Path) -> None:
    """Of a body so high that limbs hit it where they reached the wall beside it."""
    high = changed(tmp_path, ('<box size="0.30 0.22 0.06"/>', '<box size="0.30 0.24 0.32"/>'))
    limb = reaches(high)[0]
    assert 0 < limb.area_m2 < 0.95 * reaches(the_robot())[0].area_m2
    model = urdf_spec(load_robot(tmp_path / "robot")).compile()
    data = mujoco.MjData(model)
    names = [model.body(body).name for body in model.geom_bodyid]
    mine = [i for i, name in enumerate(names) if name[:2] == "LF" and name not in limb.limb.on_body]
    body = [i for i, name in enumerate(names) if name == "base"]
    for q in limb.q_rad[::5]:
        for joint, angle in zip(limb.limb.joints, q, strict=True):
            data.joint(joint.name).qpos = angle
        for finger in limb.limb.fingers:
            data.joint(finger.name).qpos = high.sections["gripper"].open_opening_m
        mujoco.mj_kinematics(model, data)
        assert min(mujoco.mj_geomDistance(model, data, i, j, 1.0, None) for i in mine for j in body) > CLEAR_M - 1e-4


def test_a_stance_keeps_limbs_off_each_other(tmp_path: Path) -> None:
    """Also where the middle of what a front limb reaches is behind that of a rear limb."""
    mount = 'xyz="{}0.1355 0.144 0" rpy="0 0 {}'
    turned = [(mount.format(sign, "1.57"), mount.format(sign, yaw)) for sign, yaw in (("", "3.57"), ("-", "-0.43"))]
    near = changed(tmp_path, *turned)
    found = reaches(near)
    assert near.model is not None
    in_the_middle = standing(near.model, [each.q_rad[each.nearest()] for each in found], OPENING_M)
    assert closest(in_the_middle)[0] < 0
    assert closest(stance(near.model, found, OPENING_M))[0] >= CLEAR_M
