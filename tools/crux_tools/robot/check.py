"""What there is to say of a robot description and the robot that it describes, topic by topic."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.joint_loop_checks import borne_dead_time_s
from crux_planner.checker.inverse_kinematics import arm_of
from crux_planner.checker.limb_model import Limb, WholeRobot

from crux_tools.preflight.machine import BAD, DOUBTFUL, GOOD, Finding
from crux_tools.robot.described import Described, reasons
from crux_tools.robot.loads import Load, least_load, peak_torques_Nm
from crux_tools.robot.singular import singular_within
from crux_tools.robot.stance import CLEAR_M, LimbReach, Stance, closest, limb_reach, stance

SLOPES_DEG = (0, 45, 90, 135, 180)
MIDDLE = "with grippers in the middle of their reach, or near it"
MEETING_M = 1e-6  # axes nearer than this meet in a point


def findings(robot: Described, friction: float, wall: Path | None = None) -> Iterator[Finding]:
    """One after the other, as they are found; a first wall is fitted and written to `wall`."""
    yield _description(robot)
    if robot.model is None:
        remedy = "the checks below need every limb's joints from body_link to its gripper"
        yield Finding("kinematics", BAD, robot.unclear, remedy)
        return
    yield _kinematics(robot.model)
    yield _masses(robot)
    yield _limits(robot, robot.model)
    if robot.sections["five_bar"].first_joint:
        yield _five_bar(robot)
    reaches = [limb_reach(robot.model.body, limb, robot.sections) for limb in robot.model.limbs]
    yield _reach(robot, reaches)
    if all(len(reach.places_m) > 0 for reach in reaches):
        where = stance(robot.model, reaches, robot.sections["gripper"].open_opening_m)
        yield _clearance(where)
        yield from _loads(where, robot.sections, friction)
    yield _gains(robot)
    if wall is not None:
        yield _first_wall(robot, friction, wall)


def _first_wall(robot: Described, friction: float, path: Path) -> Finding:
    if robot.robot is None or robot.model is None:
        return Finding("first wall", DOUBTFUL, "not fitted", "it is fitted once planner and runtime take the robot")
    from crux_tools.robot.first_wall import fitted  # the planner's model takes long to import

    return fitted(robot.robot, robot.model, friction, path)


def _description(robot: Described) -> Finding:
    if not robot.problems:
        return Finding("description", GOOD, f"{robot.files.folder}: planner and runtime take it")
    found = f"planner and runtime do not take it, for {reasons(robot.problems)}"
    return Finding("description", BAD, found, "\n          ".join(robot.problems))


def _kinematics(model: WholeRobot) -> Finding:
    texts = [f"{limb.name} {len(limb.joints)} joints, {_span_m(limb):.3f} m, {_wrist(limb)}" for limb in model.limbs]
    return Finding("kinematics", GOOD, "; ".join(texts))


def _span_m(limb: Limb) -> float:
    """From the first joint to the gripper's centre, all stretched."""
    return float(np.linalg.norm(arm_of(limb)[0].offsets, axis=1).sum())


def _wrist(limb: Limb) -> str:
    state = limb.forward(np.zeros((1, len(limb.joints))))
    origins, axes = state.joint_origin_m[0, -3:], state.joint_axis[0, -3:]
    square = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.lstsq(square.reshape(-1, 3), np.einsum("kij,kj->ki", square, origins).ravel(), rcond=None)[0]
    off = float(np.linalg.norm(np.einsum("kij,kj->ki", square, point - origins), axis=1).max())
    return "the last three axes meet" if off < MEETING_M else f"the last three axes miss a point by {1000 * off:.1f} mm"


def _masses(robot: Described) -> Finding:
    assert robot.model is not None
    model = robot.model
    each = ", ".join(f"{limb.name} {sum(link.mass_kg for link in limb.links):.2f}" for limb in model.limbs)
    found = f"{model.mass_kg:.2f} kg: body {model.body.mass_kg:.2f}, {each}"
    moving = {joint.child for limb in model.limbs for joint in (*limb.joints, *limb.fingers, limb.chain[-1])}
    light = [link.name for limb in model.limbs for link in limb.links if link.mass_kg == 0.0 and link.name in moving]
    if light or model.body.mass_kg == 0.0:
        return Finding("masses", BAD, found, f"no mass: {', '.join(light) or model.body.name}")
    return Finding("masses", GOOD, found)


def _limits(robot: Described, model: WholeRobot) -> Finding:
    free = [joint.name for limb in model.limbs for joint in limb.joints if not np.isfinite(joint.upper - joint.lower)]
    weak = [joint.name for limb in model.limbs for joint in limb.joints if not 0 < joint.effort < np.inf]
    joints = model.limbs[0].joints
    ranges = ", ".join(f"{joint.lower:.3g}..{joint.upper:.3g}" for joint in joints)
    found = f"{model.limbs[0].name} {ranges} rad; peak {', '.join(f'{joint.effort:.3g}' for joint in joints)} Nm"
    if (by := model.limbs[0].actuators) is not None:
        ends = ", ".join(f"{low:.3g}..{high:.3g}" for low, high in zip(by.low_rad, by.high_rad, strict=True))
        found += f"; actuators {ends} rad; peak {', '.join(f'{torque:.3g}' for torque in by.torque_Nm)} Nm"
    if free or weak:
        missing = [f"no limits: {', '.join(free)}" * bool(free), f"no peak torque: {', '.join(weak)}" * bool(weak)]
        return Finding("limits", BAD, found, "; ".join(filter(None, missing)))
    return Finding("limits", GOOD, found + _branch(robot))


def _branch(robot: Described) -> str:
    """Of the first limb: where plans keep to less than a joint's range."""
    limb = None if robot.robot is None else robot.robot.limbs[0]
    if limb is None or limb.branch_rad is None or not np.isfinite(limb.branch_rad).any():
        return ""
    ends = zip(limb.joint_names, limb.lower_rad, limb.upper_rad, limb.branch_rad.T, strict=False)
    kept = ", ".join(f"{name} {low:.3g}..{high:.3g}" for name, low, high, own in ends if np.isfinite(own).any())
    return f"; planned within {kept} rad, off the angle at which the limb is singular"


def _five_bar(robot: Described) -> Finding:
    """Of the first limb: what is left of its joints' ranges, and how near to singular the linkage comes there."""
    bar = None if robot.robot is None else robot.robot.limbs[0].transmission.five_bar
    if robot.robot is None or bar is None:
        return Finding("five-bar", DOUBTFUL, "not looked at", "it is once planner and runtime take the robot")
    assert robot.model is not None
    pair = slice(bar.first, bar.first + 2)
    left, own = robot.robot.limbs[0].joints[pair], robot.model.limbs[0].joints[pair]
    ranges = ", ".join(
        f"{now.name} {now.lower:.3g}..{now.upper:.3g} of {was.lower:.3g}..{was.upper:.3g} rad"
        for now, was in zip(left, own, strict=True)
    )
    ends = [np.linspace(joint.lower, joint.upper, 50) for joint in left]
    least = float(bar.sine(np.stack(np.meshgrid(*ends), axis=-1)).min())
    found = f"planned within {ranges}, where the least sine is {least:.2f}, least_sine {bar.section.least_sine:g}"
    return Finding("five-bar", GOOD, found)


def _reach(robot: Described, reaches: list[LimbReach]) -> Finding:
    texts = []
    for reach in reaches:
        text = f"{reach.limb.name} nothing"
        if len(reach.places_m) > 0:
            (x0, y0), (x1, y1) = reach.places_m.min(axis=0), reach.places_m.max(axis=0)
            text = f"{reach.limb.name} {reach.area_m2:.3f} m2 (x {x0:.2f}..{x1:.2f}, y {y0:.2f}..{y1:.2f} m)"
        texts.append(f"{text} at yaw {reach.yaw_rad:.2f}")
    low, high = robot.sections["body"].height_m
    found = f"upright grips with the body {(low + high) / 2:.3f} m off the wall: {'; '.join(texts)}"
    missing = [reach.limb.name for reach in reaches if len(reach.places_m) == 0]
    remedy = "other joint limits, body.height_m, grasp.pad_height_m or grasp.gripper_yaw_rad"
    if missing:
        return Finding("reach", BAD, found, f"{', '.join(missing)}: no grip within the joint limits; needs {remedy}")
    kept = [None] * len(reaches) if robot.robot is None else [limb.branch_rad for limb in robot.robot.limbs]
    said = (singular_within(reach.limb, reach.q_rad, each) for reach, each in zip(reaches, kept, strict=True))
    if singular := list(filter(None, said)):
        return Finding("reach", DOUBTFUL, found, "\n          ".join(singular))
    return Finding("reach", GOOD, found)


def _clearance(where: Stance) -> Finding:
    gap_m, pair = closest(where)
    if not np.isfinite(gap_m):
        return Finding("self-collision", DOUBTFUL, "no shapes", "give links boxes, spheres, cylinders or capsules")
    found = f"{MIDDLE}, {pair}: {1000 * gap_m:.0f} mm"
    return Finding("self-collision", GOOD if gap_m >= CLEAR_M else BAD, found, "the links' shapes overlap, or nearly")


def _loads(where: Stance, sections: dict[str, Any], friction: float) -> Iterator[Finding]:
    peaks, most_N = peak_torques_Nm(where.model.limbs), sections["gripper"].max_finger_force_N
    lasting = np.array(sections["servo"].continuous_torque_Nm)
    kinds = [("peak torques", peaks)]
    if all(len(limb.joints) == len(lasting) for limb in where.model.limbs):
        kinds.append(("continuous torques", [lasting] * len(where.model.limbs)))
    for name, limits in kinds:
        if not all(np.isfinite(each).all() and (each > 0).all() for each in limits):
            continue
        texts: list[str] = []
        failed: dict[str, list[int]] = {"four": [], "three": []}
        slips = False
        for slope in SLOPES_DEG:
            hung = [
                least_load(where, np.radians(slope), limits, friction, most_N, lifted)
                for lifted in (None, *range(len(where.model.limbs)))
            ]
            texts.append(f"{slope} degrees {_shown(hung[:1])}, on three limbs {_shown(hung[1:])}")
            for count, loads in zip(failed, (hung[:1], hung[1:]), strict=True):
                if any(load is None or load.share > 1.0 for load in loads):
                    failed[count].append(slope)
            slips |= None in hung
        found = f"share that hanging takes, {MIDDLE}, friction {friction:g}: {'; '.join(texts)}"
        remedy = f"{'does not hold' if limits is peaks else 'heats up'} {_where(failed)}"
        if slips:
            remedy += f"; where it slips, fingers need more than {most_N:g} N (gripper.max_finger_force_N)"
        yield Finding(name, DOUBTFUL if any(failed.values()) else GOOD, found, remedy)


def _where(failed: dict[str, list[int]]) -> str:
    """Slopes by the number of limbs that fail there."""
    each = (f"on {count} limbs at {', '.join(map(str, slopes))} degrees" for count, slopes in failed.items() if slopes)
    return ", ".join(each)


def _shown(loads: list[Load | None]) -> str:
    """Of the hardest case."""
    if None in loads:
        return "slips"
    hardest = max((load for load in loads if load is not None), key=lambda load: load.share)
    return f"{hardest.share:.2f} ({hardest.joint})"


def _gains(robot: Described) -> Finding:
    if robot.robot is None:
        return Finding("gains", DOUBTFUL, "not looked at", "they are checked once planner and runtime take the robot")
    borne, is_s = borne_dead_time_s(robot.robot), robot.robot.servo.dead_time_s
    found = f"the joints' loops bear a dead time of {1000 * borne:.1f} ms, servo.dead_time_s says {1000 * is_s:.1f} ms"
    return Finding("gains", GOOD, found)
