"""The robot as its URDF gives it: serial chains, masses and link shapes, vectorised over samples.

Frames and signs are the URDF's. Everything is computed in the body frame B with the body fixed; gravity is turned into
B by the caller. Nothing here knows the closed form of the limb: chains are walked joint by joint.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import accumulate
from xml.etree import ElementTree

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.urdf import link_shapes
from crux_msgs.robot_keys import FiveBar, Transmissions

from crux_planner.checker.actuators import Actuators, read_actuators
from crux_planner.checker.geometry import Array, about_z, cross, rotation_from_rpy, turned
from crux_planner.checker.linkage import read_linkage


class RobotModelError(ValueError):
    """The URDF lacks a link or joint that the robot description names, or holds an unknown shape."""


@dataclass(frozen=True)
class Capsule:
    """A sphere swept along a segment, in the frame of its link."""

    start_m: Array
    end_m: Array
    radius_m: float


@dataclass(frozen=True)
class Box:
    """A cuboid in the frame of its link."""

    centre_m: Array
    rotation: Array
    half_m: Array


@dataclass(frozen=True)
class Link:
    """Mass, centre of mass, inertia about it (in the link's frame) and shapes of one link."""

    name: str
    mass_kg: float = 0.0
    com_m: Array = field(default_factory=lambda: np.zeros(3))
    inertia_kg_m2: Array = field(default_factory=lambda: np.zeros((3, 3)))
    capsules: tuple[Capsule, ...] = ()
    boxes: tuple[Box, ...] = ()


@dataclass(frozen=True)
class Joint:
    """One URDF joint with its limits; fixed joints have kind "fixed"."""

    name: str
    kind: str
    parent: str
    child: str
    origin_m: Array
    rotation: Array
    axis: Array
    lower: float
    upper: float
    effort: float
    velocity: float


@dataclass(frozen=True)
class ChainState:
    """Where one limb is, for n samples: link poses by name, (n, 3) and (n, 3, 3), joint origins (n, J, 3) and axes
    (n, J, 3), in B, of joints at (n, J). Views of arrays that lie component by component.
    """

    link_position_m: dict[str, Array]
    link_rotation: dict[str, Array]
    joint_origin_m: Array
    joint_axis: Array
    q_rad: Array


BEARERS = ("joint", "actuator")
"""What Limb.borne is about, in its order."""


@dataclass(frozen=True, eq=False)
class Limb:
    """A chain of J revolute joints from the body to the gripper frame, and the finger slides behind it."""

    name: str
    chain: tuple[Joint, ...]
    fingers: tuple[Joint, ...]
    joints: tuple[Joint, ...]
    gripper: str
    links: tuple[Link, ...]
    actuators: Actuators | None = None
    """none where each joint is one"""

    @cached_property
    def lower_rad(self) -> Array:
        """Lower joint limits, shape (J,)."""
        return np.array([j.lower for j in self.joints])

    @cached_property
    def upper_rad(self) -> Array:
        """Upper joint limits, shape (J,)."""
        return np.array([j.upper for j in self.joints])

    def borne(self, state: ChainState, torque_Nm: Array) -> tuple[Array, Array, tuple[str, ...]]:
        """Of joint torques (T, J) in a state: torques (T, K) of all that has a limit, those (K,), and names: the
        joints, and behind them actuators.
        """
        names, most_Nm = tuple(joint.name for joint in self.joints), np.array([joint.effort for joint in self.joints])
        if self.actuators is None:
            return torque_Nm, most_Nm, names
        both = np.hstack([torque_Nm, self.actuators.torques_Nm(state.q_rad, torque_Nm)])
        return both, np.concatenate([most_Nm, self.actuators.torque_Nm]), names + self.actuators.names

    @cached_property
    def on_body(self) -> frozenset[str]:
        """Links up to the one that the first joint turns."""
        first = next(i for i, joint in enumerate(self.chain) if joint.kind == "revolute")
        return frozenset(joint.child for joint in self.chain[: first + 1])

    @cached_property
    def _turns(self) -> list[tuple[Joint, Array, Array]]:
        """The chain's joints with the constant turn before each, to a frame whose z is the axis of one that turns, and
        the one back from there, transposed.
        """
        frames = [axis_frame(joint.axis) if joint.kind == "revolute" else np.eye(3) for joint in self.chain]
        return [(joint, (joint.rotation @ to).T, to) for joint, to in zip(self.chain, frames, strict=True)]

    def forward(self, q_rad: Array, opening_m: Array | None = None) -> ChainState:
        """Poses of all links for joint angles (n, J) and finger openings (n,); fingers are left out without these."""
        n = len(q_rad)
        sine, cosine = np.sin(q_rad.T), np.cos(q_rad.T)
        position, columns = np.zeros((3, 1)), np.eye(3)[..., None]  # columns of the rotation, components, samples
        positions, rotations = {}, {}
        origins, axes = np.empty((2, 3, len(self.joints), n))
        i = 0
        for joint, before, back in self._turns:
            if joint.origin_m.any():
                position = position + np.tensordot(joint.origin_m, columns, axes=1)
            if (before != np.eye(3)).any():
                columns = np.tensordot(before, columns, axes=1)
            if joint.kind == "revolute":
                origins[:, i], axes[:, i] = position, columns[2]
                columns = np.tensordot(back, about_z(columns, sine[i], cosine[i]), axes=1)
                i += 1
            positions[joint.child], rotations[joint.child] = position, columns
        if opening_m is not None:
            for joint in self.fingers:
                start, slide = (np.tensordot(v, columns, axes=1) for v in (joint.origin_m, joint.rotation @ joint.axis))
                positions[joint.child] = position + start + opening_m * slide
                rotations[joint.child] = np.tensordot(joint.rotation.T, columns, axes=1)
        return ChainState(
            {name: np.broadcast_to(p, (3, n)).T for name, p in positions.items()},
            {name: np.broadcast_to(r, (3, 3, n)).T for name, r in rotations.items()},
            origins.T,
            axes.T,
            q_rad,
        )

    def gravity_torque(self, state: ChainState, gravity_b_m_s2: Array) -> Array:
        """Joint torques (n, J) that carry the limb's own links under gravity (n, 3) given in B."""
        origins, axes, gravity = state.joint_origin_m.T, state.joint_axis.T, gravity_b_m_s2.T
        torque = np.zeros(axes.shape[1:])
        mass, moment = 0.0, np.zeros((3, axes.shape[2]))  # of all links behind a joint
        for i in range(len(self.joints) - 1, -1, -1):
            for link in self.links:
                if link.mass_kg > 0.0 and link.name in state.link_position_m and self._depth[link.name] == i + 1:
                    at = state.link_position_m[link.name].T
                    mass += link.mass_kg
                    moment += link.mass_kg * (at + np.tensordot(link.com_m, state.link_rotation[link.name].T, axes=1))
            torque[i] = -(axes[:, i] * cross(moment - mass * origins[:, i], gravity)).sum(axis=0)
        return torque.T

    def contact_torque(self, state: ChainState, force_b_N: Array, moment_b_Nm: Array) -> Array:
        """Joint torques (n, J) that hold a wrench (n, 3), (n, 3) acting on the robot at the gripper frame: -J^T w."""
        arm = state.link_position_m[self.gripper].T[:, None] - state.joint_origin_m.T
        load = cross(arm, force_b_N.T[:, None]) + moment_b_Nm.T[:, None]
        return np.asarray(-(state.joint_axis.T * load).sum(axis=0).T)

    def first_moment(self, state: ChainState) -> Array:
        """Sum (n, 3) of mass times place of the limb's links, in B; needs a state with fingers."""
        placed = ((link, state.link_position_m[link.name], state.link_rotation[link.name]) for link in self.links)
        return np.asarray(sum(link.mass_kg * (at + turned(turn, link.com_m)) for link, at, turn in placed))

    @cached_property
    def _depth(self) -> dict[str, int]:
        """Number of revolute joints before each link."""
        before = accumulate(joint.kind == "revolute" for joint in (*self.chain, *self.fingers))
        return {joint.child: depth for joint, depth in zip((*self.chain, *self.fingers), before, strict=True)}


@dataclass(frozen=True)
class WholeRobot:
    """Body link and limbs; `mass_kg` is the whole robot's."""

    body: Link
    limbs: tuple[Limb, ...]

    @property
    def mass_kg(self) -> float:
        """Mass of all links."""
        return self.body.mass_kg + sum(link.mass_kg for limb in self.limbs for link in limb.links)

    def centre_of_mass(self, states: list[ChainState]) -> Array:
        """Centre of mass (n, 3) in B, of the limbs' states with fingers."""
        moments = [limb.first_moment(state) for limb, state in zip(self.limbs, states, strict=True)]
        return np.asarray((self.body.mass_kg * self.body.com_m + np.sum(moments, axis=0)) / self.mass_kg)

    def inertia(self, states: list[ChainState], at: int) -> Array:
        """Composite inertia (3, 3) about the centre of mass, axes of B, at sample `at` of states with fingers."""
        total = _about_origin(self.body, np.zeros(3), np.eye(3))
        for limb, state in zip(self.limbs, states, strict=True):
            for link in limb.links:
                place, rotation = state.link_position_m[link.name][at], state.link_rotation[link.name][at]
                total = total + _about_origin(link, place, rotation)
        return total - _point_mass(self.mass_kg, self.centre_of_mass(states)[at])


def axis_frame(axis: Array) -> Array:
    """A frame (3, 3) whose z is a unit vector: the frame itself where that is z already."""
    if axis[2] == 1.0:
        return np.eye(3)
    aside = np.cross(np.eye(3)[np.argmin(np.abs(axis))], axis)
    x = aside / np.linalg.norm(aside)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def load_model(robot: Robot) -> WholeRobot:
    """The robot's links, joints and shapes from its URDF. Raises RobotModelError."""
    limbs = tuple((limb.name, limb.gripper_link, limb.joint_names, limb.finger_joints) for limb in robot.limbs)
    return read_model(robot.urdf_path.read_bytes(), robot.body_link, limbs, robot.transmissions, robot.five_bar)


@lru_cache(maxsize=4)
def read_model(
    urdf: bytes,
    body_link: str,
    limb_names: tuple[tuple[str, str, tuple[str, ...], tuple[str, ...]], ...],
    transmissions: Transmissions | None = None,
    five_bar: FiveBar | None = None,
) -> WholeRobot:
    """The same of a URDF, and of limbs by name, gripper link, joints from the body outwards, and finger joints; and of
    what turns the joints, where something else does.
    """
    root = ElementTree.fromstring(urdf)
    links = {e.attrib["name"]: _read_link(e) for e in root.iter("link")}
    joints = {e.attrib["name"]: _read_joint(e) for e in root.findall("joint")}
    by_child = {j.child: j for j in joints.values()}
    limbs = []
    for name, gripper, joint_names, finger_joints in limb_names:
        chain: list[Joint] = []
        link = gripper
        while link != body_link:
            if link not in by_child:
                raise RobotModelError(f"link {link!r} of limb {name} does not hang on {body_link!r}")
            chain.insert(0, by_child[link])
            link = by_child[link].parent
        moving = tuple(j for j in chain if j.kind != "fixed")
        if tuple(j.name for j in moving) != joint_names or any(j.kind != "revolute" for j in moving):
            found = [j.name for j in moving]
            raise RobotModelError(f"limb {name}: revolute joints {found}, expected {list(joint_names)}")
        fingers = tuple(joints[finger] for finger in finger_joints)
        names = [j.child for j in chain] + [j.child for j in fingers]
        limits = np.array([(joint.velocity, joint.effort) for joint in moving])
        limb = Limb(name, tuple(chain), fingers, moving, gripper, tuple(links[n] for n in names))
        at_zero = limb.forward(np.zeros((1, len(moving))))
        range_rad = limb.lower_rad, limb.upper_rad
        linkage = read_linkage(five_bar, at_zero.joint_origin_m[0], at_zero.joint_axis[0], range_rad)
        limbs.append(replace(limb, actuators=read_actuators(transmissions, linkage, joint_names, *limits.T)))
    return WholeRobot(links[body_link], tuple(limbs))


def _about_origin(link: Link, position: Array, rotation: Array) -> Array:
    steiner = _point_mass(link.mass_kg, position + rotation @ link.com_m)
    return np.asarray(rotation @ link.inertia_kg_m2 @ rotation.T + steiner)


def _point_mass(mass_kg: float, place: Array) -> Array:
    """Inertia (3, 3) about the origin of a mass at a place (3,)."""
    return np.asarray(mass_kg * (place @ place * np.eye(3) - np.outer(place, place)))


def _vector(text: str | None, default: str) -> Array:
    return np.array([float(v) for v in (text or default).split()])


def _origin(element: ElementTree.Element | None) -> tuple[Array, Array]:
    if element is None:
        return np.zeros(3), np.eye(3)
    return _vector(element.get("xyz"), "0 0 0"), rotation_from_rpy(_vector(element.get("rpy"), "0 0 0"))


def _read_joint(element: ElementTree.Element) -> Joint:
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    if parent is None or child is None:
        raise RobotModelError(f"joint {element.get('name')!r} lacks parent or child")
    origin, rotation = _origin(element.find("origin"))
    axis_element = element.find("axis")
    turns = element.attrib["type"] != "fixed"  # what stands still may have an axis of no length
    axis = _vector(axis_element.get("xyz") if axis_element is not None and turns else None, "1 0 0")
    bounds = {} if limit is None else limit.attrib
    limits = (float(bounds.get(name, default)) for name, default in _UNLIMITED.items())
    kind = "revolute" if element.attrib["type"] == "continuous" else element.attrib["type"]
    names = element.attrib["name"], kind, parent.attrib["link"], child.attrib["link"]
    return Joint(*names, origin, rotation, axis / np.linalg.norm(axis), *limits)


_UNLIMITED = {"lower": -np.inf, "upper": np.inf, "effort": np.inf, "velocity": np.inf}


def _read_link(element: ElementTree.Element) -> Link:
    name, inertial = element.attrib["name"], element.find("inertial")
    mass, com, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        com, rotation = _origin(inertial.find("origin"))
        mass_element, tensor = inertial.find("mass"), inertial.find("inertia")
        mass = 0.0 if mass_element is None else float(mass_element.attrib["value"])
        if tensor is not None:
            xx, xy, xz, yy, yz, zz = (float(tensor.attrib[k]) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            inertia = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    capsules: list[Capsule] = []
    boxes: list[Box] = []
    for shape in link_shapes(element):
        centre, rotation = _origin(shape.find("origin"))
        geometry = shape.find("geometry")
        solid = None if geometry is None or len(geometry) == 0 else geometry[0]
        if solid is None:
            raise RobotModelError(f"link {name!r} has a shape without geometry")
        if solid.tag == "box":
            boxes.append(Box(centre, rotation, 0.5 * _vector(solid.get("size"), "0 0 0")))
        elif solid.tag == "sphere":
            capsules.append(Capsule(centre, centre, float(solid.attrib["radius"])))
        elif solid.tag in ("cylinder", "capsule"):
            # a cylinder becomes the capsule with its end faces' centres on the surface: flat ends lose their rims only
            radius = float(solid.attrib["radius"])
            inset = 0.0 if solid.tag == "capsule" else radius
            reach = max(0.5 * float(solid.attrib["length"]) - inset, 0.0)
            along = rotation @ np.array([0.0, 0.0, reach])
            capsules.append(Capsule(centre - along, centre + along, radius))
        else:
            raise RobotModelError(f"link {name!r} has a shape of unknown kind {solid.tag!r}")
    return Link(name, mass, com, inertia, tuple(capsules), tuple(boxes))
