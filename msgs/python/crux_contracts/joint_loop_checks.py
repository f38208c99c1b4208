"""How late a joint's answer may come before its position loop oscillates, judged when a robot description is read.

The runtime has the same check (runtime/core/robot/joint_loops.cpp); tests/cross/test_robot_verdicts.py holds both to
it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .robot_bounds import DEAD_TIME_MARGIN, LOOP_HALVINGS, LOOP_HIGHEST_1_S, LOOP_LOWEST_1_S, LOOP_STEP, LOOP_STEPS
from .robot_types import Limb, Robot
from .urdf import Urdf, about, rotation
from .yaml_document import Problem

Array = NDArray[np.float64]


def joint_loop_problems(robot: Robot) -> Iterator[Problem]:
    """What is wrong with the gains of section servo, of the first limb at which something is."""
    needed_s = DEAD_TIME_MARGIN * robot.servo.dead_time_s
    each = _loops_and_margins(robot)
    loops, margins_s = next((each for each in each if float(each[1].min()) < needed_s), (None, np.zeros(0)))
    if loops is None:
        return
    why = (
        f"a delay margin of {margins_s.min():.2g} s in the worst posture, expected at least {needed_s:.2g}: "
        f"{DEAD_TIME_MARGIN:g} times dead_time_s"
    )
    other = _other_gains(loops, int(margins_s.argmin()), needed_s)
    if other is not None:
        why += f", as with [{_listed(other.velocity)}]"
        if not np.array_equal(other.position, loops.position):
            why += f" and position_gain_Nm_rad [{_listed(other.position)}]"
    yield Problem("servo.velocity_gain_Nms_rad", f"[{_listed(loops.velocity)}]", why)


def borne_dead_time_s(robot: Robot) -> float:
    """That the joint gains bear with their margin."""
    return float(min(margins_s.min() for _, margins_s in _loops_and_margins(robot))) / DEAD_TIME_MARGIN


def _loops_and_margins(robot: Robot) -> Iterator[tuple[JointLoops, Array]]:
    """Of each limb that is not built like one before it, but for rounding."""
    before: list[Array] = []
    for limb in robot.limbs:
        loops = joint_loops(robot, limb, np.array(list(postures(limb))))
        alike = (other for other in before if other.shape == loops.inertia.shape)
        if not any(np.allclose(loops.inertia, other, rtol=1e-9, atol=1e-12) for other in alike):
            before.append(loops.inertia)
            yield loops, loops.delay_margins_s()


def joint_loops(robot: Robot, limb: Limb, postures_rad: Array) -> JointLoops:
    """Of the actuators of a limb with its joints at `postures_rad` (n, J)."""
    servo, own = robot.servo, len(limb.joints)
    inertias = np.array([joint_inertia(robot.urdf, limb, q_rad) for q_rad in postures_rad])
    if not limb.transmission.direct:
        back = np.linalg.inv(limb.transmission.slope(postures_rad))
        inertias = np.swapaxes(back, -1, -2) @ inertias @ back
    return JointLoops(
        inertias + np.diag(servo.armature_kg_m2[:own]),
        np.array(servo.position_gain_Nm_rad[:own]),
        np.array(servo.velocity_gain_Nms_rad[:own]),
        np.array(servo.damping_Nms_rad[:own]),
        servo.torque_time_constant_s,
    )


def _other_gains(loops: JointLoops, worst: int, needed_s: float) -> JointLoops | None:
    """The nearest gains that do in all postures, looked for in the `worst` one; position gains change as little as they
    can."""
    steps = sorted(range(-LOOP_STEPS, LOOP_STEPS + 1), key=abs)
    velocity = loops.velocity * (LOOP_STEP ** np.array(steps))[:, None]
    for position_step in range(LOOP_STEPS):
        position = loops.position * LOOP_STEP**position_step
        tried = replace(loops, inertia=loops.inertia[worst], position=position, velocity=velocity)
        for index in np.flatnonzero(tried.delay_margins_s() >= needed_s):
            other = replace(loops, position=position, velocity=velocity[index])
            if float(other.delay_margins_s().min()) >= needed_s:
                return other
    return None


@dataclass(frozen=True)
class JointLoops:
    """Position loops of a limb's actuators, in several postures or with several gains (n)."""

    inertia: Array
    """(n, J, J) or (J, J) as the actuators feel it, with rotors [kg m²]"""
    position: Array
    """gains k_p, (n, J) or (J,)"""
    velocity: Array
    """gains k_d, as well"""
    damping: Array
    """(J,) viscous friction b"""
    lag_s: float
    """T of the torque"""

    def delay_margins_s(self) -> Array:
        """(n,) delay at which the loops begin to oscillate: the least (π + arg λ) / ω over the frequencies ω at which
        an eigenvalue λ of (M·s² + b·s)⁻¹ (k_d·s + k_p) / (1 + T·s), s = jω, has absolute value 1 (generalised Nyquist
        criterion); infinite where none has."""
        count = np.broadcast_shapes(self.inertia.shape[:-2], self.position.shape[:-1], self.velocity.shape[:-1])
        low = np.full((*count, len(self.damping)), LOOP_LOWEST_1_S)
        high = np.full_like(low, LOOP_HIGHEST_1_S)
        # The k-th largest eigenvalue passes 1 once: loops lose gain with frequency.
        for _ in range(LOOP_HALVINGS):
            middle = np.sqrt(low * high)
            above = np.abs(self._eigenvalues(middle)) >= 1.0
            low, high = np.where(above, middle, low), np.where(above, high, middle)
        values = self._eigenvalues(low)
        margins_s = np.where(np.abs(values) >= 1.0, (math.pi + np.angle(values)) / low, math.inf)
        return np.asarray(margins_s.min(axis=1))

    def _eigenvalues(self, omega_1_s: Array) -> NDArray[np.complex128]:
        """(n, J) the k-th largest eigenvalue of each loop at the k-th of its frequencies `omega_1_s` (n, J)."""
        s = 1j * omega_1_s[:, :, None, None]
        each = np.eye(len(self.damping))
        plant = self.inertia[..., None, :, :] * s * s + self.damping * each * s
        gains = self.velocity[..., None, None, :] * each * s + self.position[..., None, None, :] * each
        values = np.linalg.eigvals(np.linalg.solve(plant, gains / (1.0 + self.lag_s * s)))
        largest_first = np.take_along_axis(values, np.argsort(-np.abs(values), axis=2), axis=2)
        return np.asarray(np.diagonal(largest_first, axis1=1, axis2=2))


def postures(limb: Limb) -> Iterator[Array]:
    """(J,) angles of a limb's joints, as they count them, in the air: elbow and wrist pitch at their ends and half-way,
    wrist roll half-way and at one end; what turns the limb as a whole, or its gripper, changes its inertia little and
    is half-way.
    """
    low, high = (np.array([getattr(joint, end) for joint in limb.joints]) for end in ("lower", "upper"))
    middle = (low + high) / 2
    tried = ((0.0, 0.5, 1.0), (0.0, 0.5, 1.0), (0.5, 1.0))
    for shares in itertools.product(*tried[: len(middle) - 2]):
        q_rad, at = middle.copy(), slice(2, 2 + len(shares))
        q_rad[at] = low[at] + np.array(shares) * (high[at] - low[at])
        yield q_rad


def joint_inertia(urdf: Urdf, limb: Limb, q_rad: Array) -> Array:
    """(J, J) mass matrix [kg m²] of a limb on a body that stands still, its fingers closed."""
    turn, origin = np.eye(3), np.zeros(3)
    axes, origins = np.zeros((3, len(q_rad))), np.zeros((3, len(q_rad)))
    mass = np.zeros((len(q_rad), len(q_rad)))

    def add(link: str) -> None:
        body = urdf.links[link]
        arms = (origin + turn @ np.array(body.com_m))[:, None] - origins
        moving = np.cross(axes, arms, axis=0)  # of the centre of mass; joints further out have no axis yet
        xx, xy, xz, yy, yz, zz = body.inertia_kg_m2
        inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
        mass[:] += body.mass_kg * moving.T @ moving + axes.T @ inertia @ axes

    j = 0
    for joint in urdf.chain(limb.joints[0].parent, limb.gripper_link):
        origin = origin + turn @ np.array(joint.xyz_m)
        turn = turn @ rotation(joint.rpy_rad)
        if joint.kind != "fixed":
            axes[:, j], origins[:, j] = turn @ np.array(joint.axis), origin
            turn = turn @ about(np.array(joint.axis), q_rad[j])
            j += 1
        add(joint.child)
    for finger in limb.finger_joints:
        add(urdf.joints[finger].child)
    return mass


def _listed(values: Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
