"""The robot of a robot description on the wall of a plan, as a MuJoCo model.

MuJoCo reads the URDF itself (an implementation independent of the runtime's kinematics); what a URDF cannot say comes
from robot.yaml: rotor inertia, friction, pads, the gripper's one actuator. Contacts follow the limit surface (2): a
spherical pad with condim 4 in the elliptic cone and friction (mu, mu, k mu) is exactly
(fx^2 + fy^2)/(mu fz)^2 + tz^2/(k mu fz)^2 <= 1. Micro-spines are an adhesion of spine_shear/mu per finger: an
ellipsoid instead of the box (3), with that much pull-off. Point feet stand on both pads and have Coulomb's
cone, condim 3.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from crux_contracts.interpolation import is_walk
from crux_contracts.plan_series import plan_series
from crux_contracts.robot import Limb, Robot
from crux_contracts.urdf import link_shapes
from numpy.typing import NDArray

from crux_tools.errors import UsageError
from crux_tools.robot3d.linkages import add_linkages, driven_names
from crux_tools.robot3d.wall import Face, add_wall

CONTACT_SOLREF = (0.008, 1.0)  # stiff enough that a 20 N pad sinks in 0.05 mm, soft enough for 2 ms steps
CONTACT_SOLIMP = (0.95, 0.99, 0.001, 0.5, 2.0)
COUPLING_SOLREF = (0.005, 1.0)
COUPLING_SOLIMP = (0.99, 0.999, 0.001, 0.5, 2.0)
LINK_FRICTION = (0.5, 0.005, 0.0001)  # of anything but a pad touching anything
PICTURE, UNSEEN_RGBA = "picture", (0.0, 0.0, 0.0, 0.0)
PAD_RGBA = (0.9, 0.2, 0.2, 1.0)
MIN_CAPSULE_M = 1e-4
MAX_SPINE_CONTROL = 1e3  # 1/mu of the smoothest face that spines still grip

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class RobotModel:
    """A compiled model with the addresses the plant needs; limbs in the order LF, RF, LR, RR, joints limb-major:
    S slots for each limb (Robot.slots).
    """

    model: mujoco.MjModel
    robot: Robot
    faces: list[Face]
    body: int
    joint_qpos: Ints  # (4 S,)
    joint_dof: Ints  # (4 S,)
    finger_qpos: Ints  # (4, 2)
    finger_dof: Ints  # (4, 2)
    joint_actuators: Ints  # (4 S,)
    driven_qpos: Ints  # (4 S,) of what the actuators turn: joints, or cranks in place of some
    driven_dof: Ints  # (4 S,)
    ratio: Floats  # (4 S,) of an actuator to what it turns,
    coupling: Floats  # (4 S,) to the other joint that it moves,
    coupled_to: Ints  # (4 S,) which is this one, or itself
    offset_rad: Floats  # (4 S,)
    tendon: Ints  # (4 S,) by which it moves both; -1 where it moves one
    finger_actuators: Ints  # (4, 2)
    spine_actuators: Ints  # (8,) pad order; empty without spines
    gripper_sites: Ints  # (4,)
    gripper_bodies: Ints  # (4,)
    ft_sensors: Ints  # (24,) addresses into sensordata: per limb force xyz, torque xyz
    pad_geoms: Ints  # (8,) finger 1 and 2 of LF, RF, LR, RR
    pad_of_geom: Ints  # (ngeom,) pad index or -1
    face_of_geom: Ints  # (ngeom,) index into faces or -1
    face_hold: Ints  # (nfaces,)
    point_feet: bool  # the plan is a walk on the wall itself
    stands: Bools  # (4,) limbs that stand on the wall itself at some knot: all of a walk, some on footholds
    adhesion_of_face: Floats  # (nfaces,) control of the adhesion actuator that a pad on this face gets


def _sensor_site(limb: Limb) -> str:
    return f"{limb.gripper_link}_ft"


def _pad(finger_joint: str) -> str:
    return f"{finger_joint}_pad"


def _spines(finger_joint: str) -> str:
    return f"{finger_joint}_spines"


def finger_joints(robot: Robot) -> list[str]:
    """(8,) finger 1 and 2 of LF, RF, LR, RR: the order of the pads."""
    return [joint for limb in robot.limbs for joint in limb.finger_joints]


def urdf_spec(robot: Robot) -> mujoco.MjSpec:
    """The URDF as an editable MuJoCo model, with its fixed joints: shapes that collide, and pictures that do not, but
    meshes.
    """
    tree = ET.parse(robot.urdf_path).getroot()
    for link in tree.iter("link"):
        shapes = link_shapes(link)
        for number, picture in enumerate(visual for visual in link.findall("visual") if visual not in shapes):
            if picture.find("geometry/mesh") is None:
                picture.set("name", f"{link.get('name')}/{PICTURE}{number}")
            else:
                link.remove(picture)
    extension = ET.SubElement(tree, "mujoco")
    ET.SubElement(extension, "compiler", discardvisual="false", fusestatic="false")
    return mujoco.MjSpec.from_string(ET.tostring(tree, encoding="unicode"))


def _let_shapes_collide(spec: mujoco.MjSpec) -> None:
    """With holds and wall; cylinders as the capsules inside them. Where a link has pictures, these alone are seen."""
    seen = {geom.parent.name for geom in spec.geoms if f"/{PICTURE}" in geom.name}
    for geom in spec.geoms:
        if f"/{PICTURE}" in geom.name:
            geom.mass = 0
            continue
        if geom.parent.name in seen:
            geom.rgba = UNSEEN_RGBA
        if geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE
            geom.size = [geom.size[0], max(geom.size[1] - geom.size[0], MIN_CAPSULE_M), 0]
        geom.contype, geom.conaffinity = 1, 0
        geom.friction = LINK_FRICTION
        geom.mass = 0


def _add_grippers(spec: mujoco.MjSpec, robot: Robot) -> None:
    gripper = robot.gripper
    for limb in robot.limbs:
        spec.body(limb.gripper_link).add_site(name=_sensor_site(limb))
        for kind in (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE):
            spec.add_sensor(type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=_sensor_site(limb))
        for name in limb.finger_joints:
            joint = spec.joint(name)
            joint.armature = gripper.moving_mass_kg
            joint.damping = [gripper.screw_damping_Ns_m, 0, 0]
            joint.parent.add_geom(
                name=_pad(name), type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[gripper.pad_radius_m, 0, 0], mass=0,
                pos=np.array(joint.axis) * gripper.pad_radius_m, contype=0, conaffinity=0, rgba=PAD_RGBA,
            )  # fmt: skip
            spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_motor()
        first, second = limb.finger_joints
        coupling = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=first, name2=second)
        coupling.objtype = mujoco.mjtObj.mjOBJ_JOINT
        coupling.data[:5] = [0, 1, 0, 0, 0]
        coupling.solref, coupling.solimp = COUPLING_SOLREF, COUPLING_SOLIMP


def slot_names(robot: Robot) -> list[str]:
    """(4 S,) of the joints, limb-major; a slot without a joint is a hinge of its own that nothing hangs on."""
    return [
        name
        for limb in robot.limbs
        for name in (*limb.joint_names, *(f"{limb.name}/slot{n}" for n in range(len(limb.joints) + 1, robot.slots + 1)))
    ]


def _add_idle_slots(spec: mujoco.MjSpec, robot: Robot) -> None:
    joints = {name for limb in robot.limbs for name in limb.joint_names}
    for name in slot_names(robot):
        if name not in joints:
            body = spec.worldbody.add_body(name=name, mass=1.0, inertia=[1.0] * 3, ipos=[0] * 3, explicitinertial=True)
            body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1], range=[-0.1, 0.1], damping=1.0)
            spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_motor()


def _add_servos(spec: mujoco.MjSpec, robot: Robot) -> None:
    servo, driven = robot.servo, driven_names(robot)
    for limb in robot.limbs:
        for index, (joint, turns) in enumerate(zip(limb.joints, limb.transmission.matrix, strict=True)):
            own, ratio = spec.joint(driven.get(joint.name, joint.name)), float(turns[index])
            if joint.kind == "revolute" and not limb.transmission.in_five_bar(index):
                own.range = [joint.lower, joint.upper]
            inertia, damping = servo.armature_kg_m2[index], [servo.damping_Nms_rad[index], 0, 0]
            friction = servo.friction_Nm[index]
            if np.count_nonzero(turns) > 1:
                tendon = spec.add_tendon(name=joint.name, armature=inertia, damping=damping, frictionloss=friction)
                for other in np.flatnonzero(turns):
                    tendon.wrap_joint(limb.joint_names[other], turns[other])
                spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_TENDON).set_to_motor()
                continue
            own.armature, own.frictionloss = ratio**2 * inertia, abs(ratio) * friction
            own.damping = [ratio**2 * each for each in damping]
            actuator = spec.add_actuator(name=joint.name, target=own.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            actuator.set_to_motor()
            actuator.gear[0] = ratio


def set_solver_options(spec: mujoco.MjSpec, timestep_s: float) -> None:
    """What keeps a loaded pad where it is: Euler, pyramidal cones or impratio 1 creep by centimetres a minute, and
    impratio 100 by millimetres where force control keeps a moment on both pads.

    A step is as long as a control cycle.
    """
    option = spec.option
    option.timestep = timestep_s
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 3000
    option.noslip_iterations = 5
    option.iterations = 50


def add_pad_contacts(spec: mujoco.MjSpec, pads: list[str], faces: list[Face], patch_k_m: float) -> None:
    """Lets every pad geom touch every face by the limit surface (2)."""
    rough = 4 if patch_k_m > 0 else 3
    for pad in pads:
        for face in faces:
            mu = face.friction
            spec.add_pair(
                geomname1=pad, geomname2=face.geom, condim=rough if mu > 0 else 1, solref=CONTACT_SOLREF,
                solimp=CONTACT_SOLIMP, friction=[mu, mu, face.share * patch_k_m * mu, 1e-3, 1e-3],
            )  # fmt: skip


def add_spines(spec: mujoco.MjSpec, name: str, body: str, shear_n: float) -> None:
    """Micro-spines of a finger: an adhesion whose control is 1/mu of the face it is on."""
    spine = spec.add_actuator(name=name, target=body)
    spine.set_to_adhesion(shear_n)
    spine.trntype = mujoco.mjtTrn.mjTRN_BODY
    spine.ctrlrange = [0, MAX_SPINE_CONTROL]


def build_model(robot: Robot, plan: Any, scenery: Callable[[mujoco.MjSpec], None] = lambda _spec: None) -> RobotModel:
    """Robot, wall, holds and gravity of `plan` (a plan_t) as a compiled MuJoCo model.

    `scenery` may add what only pictures need (sky, lights, cameras) before the model is compiled.
    """
    spec = urdf_spec(robot)
    spec.modelname = robot.name
    set_solver_options(spec, robot.dt_s)
    spec.option.gravity = plan.gravity_w_m_s2
    _let_shapes_collide(spec)
    spec.body(robot.body_link).add_freejoint(name="root")
    add_linkages(spec, robot)
    _add_servos(spec, robot)
    _add_idle_slots(spec, robot)
    _add_grippers(spec, robot)
    faces = add_wall(spec, plan)
    fingers = finger_joints(robot)
    add_pad_contacts(spec, [_pad(name) for name in fingers], faces, plan.patch_k_m)
    if plan.spine_shear_n > 0:
        for name in fingers:
            add_spines(spec, _spines(name), spec.joint(name).parent.name, plan.spine_shear_n)
    scenery(spec)
    try:
        model = spec.compile()
    except ValueError as error:
        raise UsageError(f"{robot.folder} on the wall of {plan.scenario_name!r}: no physics of it: {error}") from None
    return _with_addresses(model, robot, faces, is_walk(plan), np.asarray(plan_series(plan).on_wall.any(axis=0)))


def _actuators(model: mujoco.MjModel, robot: Robot) -> dict[str, Any]:
    """Of RobotModel, how actuators hang on joints."""
    count = 4 * robot.slots
    ratio, coupling, offset_rad = np.ones(count), np.zeros(count), np.zeros(count)
    coupled_to, tendon = np.arange(count), np.full(count, -1)
    for number, limb in enumerate(robot.limbs):
        for index, (turns, offset) in enumerate(
            zip(limb.transmission.matrix, limb.transmission.offset_rad, strict=True)
        ):
            slot = robot.slots * number + index
            ratio[slot], offset_rad[slot] = turns[index], offset
            for other in np.flatnonzero(turns):
                tendon[slot] = model.tendon(limb.joint_names[index]).id if np.count_nonzero(turns) > 1 else -1
                if other != index:
                    coupling[slot], coupled_to[slot] = turns[other], robot.slots * number + other
    each = {"ratio": ratio, "coupling": coupling, "coupled_to": coupled_to, "offset_rad": offset_rad}
    return each | {"tendon": tendon}


def _with_addresses(
    model: mujoco.MjModel, robot: Robot, faces: list[Face], point_feet: bool, stands: Bools
) -> RobotModel:
    joints, fingers = slot_names(robot), finger_joints(robot)
    driven = [driven_names(robot).get(name, name) for name in joints]
    sites = np.array([model.site(_sensor_site(limb)).id for limb in robot.limbs])
    ft_sensors = [
        model.sensor_adr[i] + np.arange(3) for site in sites for i in np.flatnonzero(model.sensor_objid == site)
    ]
    pad_geoms = np.array([model.geom(_pad(name)).id for name in fingers])
    pad_of_geom = np.full(model.ngeom, -1)
    pad_of_geom[pad_geoms] = np.arange(len(fingers))
    face_of_geom = np.full(model.ngeom, -1)
    face_of_geom[[model.geom(face.geom).id for face in faces]] = np.arange(len(faces))
    has_spines = model.nu > len(joints) + len(fingers)
    return RobotModel(
        model=model,
        robot=robot,
        faces=faces,
        body=model.body(robot.body_link).id,
        joint_qpos=np.array([model.joint(name).qposadr[0] for name in joints]),
        joint_dof=np.array([model.joint(name).dofadr[0] for name in joints]),
        finger_qpos=np.array([model.joint(name).qposadr[0] for name in fingers]).reshape(4, 2),
        finger_dof=np.array([model.joint(name).dofadr[0] for name in fingers]).reshape(4, 2),
        joint_actuators=np.array([model.actuator(name).id for name in joints]),
        driven_qpos=np.array([model.joint(name).qposadr[0] for name in driven]),
        driven_dof=np.array([model.joint(name).dofadr[0] for name in driven]),
        **_actuators(model, robot),
        finger_actuators=np.array([model.actuator(name).id for name in fingers]).reshape(4, 2),
        spine_actuators=np.array(
            [model.actuator(_spines(name)).id for name in fingers] if has_spines else [], dtype=np.int64
        ),
        gripper_sites=sites,
        gripper_bodies=model.site_bodyid[sites].copy(),
        ft_sensors=np.concatenate(ft_sensors),
        pad_geoms=pad_geoms,
        pad_of_geom=pad_of_geom,
        face_of_geom=face_of_geom,
        face_hold=np.array([face.hold for face in faces]),
        point_feet=point_feet,
        stands=stands,
        adhesion_of_face=np.array(
            [face.share / face.friction if face.spines and face.friction > 0 else 0.0 for face in faces]
        ),
    )
