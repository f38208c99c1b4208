"""A world as the physics takes it: holds where they really are, changes to the MuJoCo model, numbers for the plant."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_contracts.interpolation import is_walk
from crux_contracts.robot import Robot
from crux_contracts.scenario import FACE_NAMES
from crux_msgs import limb_knot_t, plan_t
from crux_tools.errors import UsageError
from crux_tools.robot3d.linkages import driven_names
from crux_tools.robot3d.robot_model import RobotModel, finger_joints, slot_names
from crux_tools.telemetry.rotations import hold_rotation, rotation_from_rpy, rpy_of

from crux_simulation.sim.native import HoldBreakRow, PlantWorld, PushRow, SensorErrorRow
from crux_simulation.sim.world import ERRORS, SENSORS, GripperChange, HoldChange, JointChange, World, joint_names

GONE_M = -10.0  # z of a hold that is not there: behind the wall
LEAST_SIZE_M = 0.005
LEAST_PART_M = 1e-4
PLAY_ARMATURE_KG_M2 = 1e-4  # of what is between motor and link
PLAY_DAMPING_NMS_RAD = 0.05
PLAY_SOLREF = (0.004, 1.0)  # the stiffest that steps of 2 ms bear
PLAY_SOLIMP = (0.98, 0.99, 0.001, 0.5, 2.0)  # stops that give 0.2 mrad at 5 Nm; stiffer ones let loaded pads creep
CRANK_PLAY_SOLIMP = (0.9996, 0.9998, 0.001, 0.5, 2.0)  # as stiff, where no link's inertia hangs on the hinge
STIFF_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # friction that holds instead of creeping
SPRING_DAMPING_RATIO = 0.1  # against the motor's inertia
HOLD_MASS_KG = 1.0  # of a hold that gives: enough that steps of 2 ms bear the stiffest
HOLD_DAMPING_RATIO = 1.0


def _change_hold(hold: Any, change: HoldChange) -> None:
    rotation = hold_rotation(hold)
    position = np.array(hold.position_w_m) + rotation @ np.array(change.offset_m)
    if change.yaw_deg:
        about_its_z = rotation_from_rpy([0.0, 0.0, math.radians(change.yaw_deg)])
        *hold.tilt_rad, hold.yaw_rad = rpy_of(rotation @ about_its_z).tolist()
    hold.size_m = np.maximum(np.array(hold.size_m) + change.size_change_m, LEAST_SIZE_M).tolist()
    hold.friction = [
        change.friction.get(face, mu) * change.friction_factor
        for face, mu in zip(FACE_NAMES, hold.friction, strict=True)
    ]
    hold.spines = [int(change.spines.get(face, bool(s))) for face, s in zip(FACE_NAMES, hold.spines, strict=True)]
    hold.position_w_m = position.tolist() if change.present else [*position[:2], GONE_M]


def true_wall(plan: plan_t, world: World) -> plan_t:
    """`plan` with the holds as they are in this world, and the grippers of its first knot on them: who sets the robot
    on the wall sees where the holds are."""
    true: plan_t = plan_t.decode(plan.encode())
    for hold in true.holds:
        if hold.name in world.holds:
            _change_hold(hold, world.holds[hold.name])
    for limb in true.knots[0].limbs:
        if is_walk(plan) or limb.phase != limb_knot_t.STANCE or limb.finger1_face == limb_knot_t.FACE_WALL:
            continue
        planned, hold = plan.holds[limb.hold], true.holds[limb.hold]
        if hold.position_w_m[2] <= GONE_M or hold.encode() == planned.encode():
            continue
        turn = hold_rotation(hold) @ hold_rotation(planned).T
        arm = turn @ (np.array(limb.gripper_position_w_m) - planned.position_w_m)
        limb.gripper_position_w_m = (np.array(hold.position_w_m) + arm).tolist()
        yaw, tilt = yaw_and_tilt(turn @ gripper_rotation(limb.gripper_yaw_w_rad, limb.gripper_tilt_w_rad))
        limb.gripper_yaw_w_rad += math.remainder(yaw - limb.gripper_yaw_w_rad, math.tau)
        limb.gripper_tilt_w_rad = tilt.tolist()
        axis = 0 if limb.finger1_face in (limb_knot_t.FACE_PLUS_X, limb_knot_t.FACE_MINUS_X) else 1
        limb.finger_separation_m += hold.size_m[axis] - planned.size_m[axis]
    return true


def change_robot(spec: mujoco.MjSpec, robot: Robot, world: World) -> None:
    """Adds to a model what this world puts on the robot and into its joints, before it is compiled."""
    if world.payload.mass_kg > 0:
        spec.body(robot.body_link).add_body(
            name="payload", pos=world.payload.position_m, ipos=[0, 0, 0], mass=world.payload.mass_kg,
            inertia=[1e-6] * 3, explicitinertial=True,
        )  # fmt: skip
    for name, place in zip(slot_names(robot), joint_names(robot.slots), strict=True):
        change, drive = world.joints.get(place, JointChange()), spec.actuator(name)
        if not change.mechanical:
            continue
        if drive.trntype == mujoco.mjtTrn.mjTRN_TENDON:
            raise UsageError(f"joints.{place}: no friction, play or elasticity in drives that move two joints")
        solimp = PLAY_SOLIMP if drive.target == name else CRANK_PLAY_SOLIMP
        _change_drive(spec.joint(drive.target), change, float(drive.gear[0]), solimp)
    for name, limb in zip(finger_joints(robot), np.repeat(LIMB_NAMES, 2), strict=True):
        if limb in world.grippers:
            spec.joint(name).solimp_friction, spec.joint(name).solref_friction = STIFF_SOLIMP, PLAY_SOLREF


def cut_corners(spec: mujoco.MjSpec, wall: plan_t, world: World) -> None:
    """Takes a corner off the holds of the true `wall` that lack one."""
    for index, hold in enumerate(wall.holds):
        cut = np.array(world.holds.get(hold.name, HoldChange()).corner_cut_m)
        if not cut.all():
            continue
        size = np.array(hold.size_m[:2])
        corner, cut = np.copysign(size / 2, cut), np.copysign(np.minimum(np.abs(cut), 0.99 * size), cut)
        for geom in spec.body(f"hold{index}").geoms:  # one, or slabs
            outline = _beyond_cut(geom.pos[:2], geom.size[:2], corner, cut)
            if len(outline) < 3:  # nothing is left of this slab
                geom.size = [LEAST_PART_M] * 3
                continue
            ends = [[*point, geom.pos[2] + side * geom.size[2]] for point in outline for side in (-1, 1)]
            mesh = spec.add_mesh(name=f"{geom.name}_cut", uservert=np.ravel(ends).tolist())
            geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, mesh.name
            geom.pos = [0, 0, 0]


def _beyond_cut(middle: Any, half: Any, corner: Any, cut: Any) -> list[Any]:
    """Outline of what is left of a rectangle."""
    points = [middle + half * side for side in ([1, 1], [-1, 1], [-1, -1], [1, -1])]
    inside = [float(np.sum((corner - point) / cut)) - 1.0 for point in points]
    outline = []
    for i, (point, here) in enumerate(zip(points, inside, strict=True)):
        there = inside[(i + 1) % 4]
        if here >= 0:
            outline.append(point)
        if here * there < 0:
            outline.append(point + (points[(i + 1) % 4] - point) * here / (here - there))
    return outline


def loosen_holds(spec: mujoco.MjSpec, plan: plan_t, world: World) -> None:
    """Puts the holds that give on springs or in viscous mountings, along each axis of their own frames; without
    weight."""
    for index, hold in enumerate(plan.holds):
        change = world.holds.get(hold.name, HoldChange())
        creeps = math.isfinite(change.viscosity_Ns_m)
        if math.isinf(change.stiffness_N_m) and not creeps:
            continue
        stiffness = 0.0 if math.isinf(change.stiffness_N_m) else change.stiffness_N_m
        body = spec.body(f"hold{index}")
        body.mass, body.inertia, body.explicitinertial = HOLD_MASS_KG, [1e-3] * 3, True
        body.gravcomp = 1.0
        spring_damping = 2 * HOLD_DAMPING_RATIO * math.sqrt(stiffness * HOLD_MASS_KG)
        damping = change.viscosity_Ns_m if creeps else spring_damping
        for axis in np.eye(3):
            body.add_joint(
                type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, stiffness=[stiffness, 0, 0], damping=[damping, 0, 0]
            )


def _change_drive(joint: Any, change: JointChange, ratio: float, play_solimp: tuple[float, ...]) -> None:
    """Motor and link turn about the same axis: the hinge itself is the motor's, what lies between has its own. What the
    world says is in the actuator's angles.
    """
    if change.friction_Nm + change.stiction_Nm > 0:
        joint.frictionloss += abs(ratio) * change.friction_Nm
        joint.solimp_friction, joint.solref_friction = STIFF_SOLIMP, PLAY_SOLREF
    if change.backlash_rad > 0 or math.isfinite(change.stiffness_Nm_rad):
        half, rigid = change.backlash_rad / 2 / abs(ratio), math.isinf(change.stiffness_Nm_rad)
        stiffness = 0.0 if rigid else ratio**2 * change.stiffness_Nm_rad
        joint.parent.add_joint(
            name=_play(joint.name), axis=joint.axis, pos=joint.pos, type=joint.type, armature=PLAY_ARMATURE_KG_M2,
            damping=[PLAY_DAMPING_NMS_RAD + 2 * SPRING_DAMPING_RATIO * math.sqrt(stiffness * joint.armature), 0, 0],
            limited=rigid, range=[-half, half], solref_limit=PLAY_SOLREF, solimp_limit=play_solimp,
        )  # fmt: skip


def _play(joint: str) -> str:
    return f"{joint}_play"


def _rows(kind: Any, rows: Sequence[Any]) -> Any:
    return (kind * len(rows))(*rows)


def _sensor_rows(world: World, slots: int) -> list[SensorErrorRow]:
    rows = []
    for error in world.sensors:
        places = joint_names(slots) if error.sensor == "encoder" else LIMB_NAMES
        if error.on not in places:
            continue
        row = SensorErrorRow(
            list(SENSORS).index(error.sensor), places.index(error.on), ERRORS.index(error.error),
            from_s=error.from_s, until_s=error.from_s + error.for_s,
        )  # fmt: skip
        row.value[: len(error.values)] = error.values
        rows.append(row)
    return rows


def plant_world(world: World, robot: RobotModel, names: Sequence[str]) -> PlantWorld:
    """The numbers of `world` for the plant; `names` of the plan's holds. It keeps alive what it points at."""
    joints = [world.joints.get(place, JointChange()) for place in joint_names(robot.robot.slots)]
    grippers = [world.grippers.get(limb, GripperChange()) for limb in LIMB_NAMES]
    lags = np.array([joint.lag_s for joint in joints])
    dt_s, sensors = float(robot.model.opt.timestep), robot.robot.force_torque
    breaks = [
        HoldBreakRow(robot.model.body(f"hold{names.index(name)}").id, change.breaks_at_N, change.breaks_at_s)
        for name, change in world.holds.items()
        if change.present and math.isfinite(min(change.breaks_at_N, change.breaks_at_s))
    ]
    pushes = [
        PushRow((ctypes.c_double * 6)(*push.force_N, *push.moment_Nm), push.at_s, push.at_s + push.for_s)
        for push in world.pushes
    ]
    elastic = [math.isfinite(joint.stiffness_Nm_rad) for joint in joints]
    turned, ratio = driven_names(robot.robot), np.abs(robot.ratio)
    slots = zip(slot_names(robot.robot), elastic, strict=True)
    plays = [robot.model.joint(_play(turned.get(name, name))) if gives else None for name, gives in slots]
    numbers = PlantWorld(ambient_degc=world.ambient_degC, gone_m=GONE_M)
    columns: dict[str, Any] = {
        "torque_factor": [joint.torque_factor for joint in joints],
        "torque_limit_nm": [joint.torque_limit_Nm for joint in joints],
        "torque_share": np.where(lags > 0, 1 - np.exp(-dt_s / np.maximum(lags, 1e-9)), 1.0),
        "half_play_rad": np.array([joint.backlash_rad / 2 for joint in joints]) / ratio,
        "stiffness_nm_rad": np.array([joint.stiffness_Nm_rad for joint in joints]) * ratio**2,
        "play_qpos": [-1 if play is None else play.qposadr[0] for play in plays],
        "play_dof": [-1 if play is None else play.dofadr[0] for play in plays],
        "stiction_nm": np.array([joint.stiction_Nm for joint in joints]) * ratio,
        "heating_k_nm2": [joint.heating_K_Nm2 for joint in joints],
        "heating_time_s": [joint.heating_time_s for joint in joints],
        "dead_cycles": [round(joint.dead_cycles) for joint in joints],
        "finger_force_factor": [gripper.force_factor for gripper in grippers],
        "finger_force_limit_n": [gripper.force_limit_N for gripper in grippers],
        "jam_m": [math.nan if gripper.jams_at_m is None else gripper.jams_at_m for gripper in grippers],
        "jam_s": [
            0.0 if gripper.jams_at_m is not None and math.isinf(gripper.jams_at_s) else gripper.jams_at_s
            for gripper in grippers
        ],
        "ft_range": np.repeat([sensors.range_N, sensors.range_Nm], 3),
    }
    for name, values in columns.items():
        getattr(numbers, name)[: len(values)] = np.asarray(values).tolist()
    for name, kind, rows in (
        ("sensor_errors", SensorErrorRow, _sensor_rows(world, robot.robot.slots)),
        ("pushes", PushRow, pushes),
        ("breaks", HoldBreakRow, breaks),
    ):
        setattr(numbers, name, _rows(kind, rows))
        setattr(numbers, f"{name}_count", len(rows))
    return numbers
