"""What torques a robot needs to hang still on a wall: the least load of its busiest joint, or of the actuator in its
place, over how grips share it.

A grip presses with both fingers along its opening axis, shares two shear forces and a twist about that axis between
them, and holds what is inside |s1| / mu + |s2| / mu + |m| / (k mu) <= n of each finger: inside the limit surface (2).
A linear program with variables s1, s2, m, n1, n2 of every gripping limb, and the load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from crux_contracts.scenario_types import GRAVITY_M_S2
from crux_planner.checker.limb_model import ChainState, Limb
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, linprog

from crux_tools.robot.stance import Stance

Array = NDArray[np.float64]
PATCH_K_M = 2 / 3 * 0.02  # twist of a contact patch of 2 cm, as scenarios have it
GRIP = 5  # variables of a grip: s1, s2, m, n1, n2
SPARE = 1e-9  # of the least load, that another way to share it may take besides


@dataclass(frozen=True)
class Load:
    """Of the busiest joint: torque over its limit, and its name."""

    share: float
    joint: str


@dataclass(frozen=True)
class JointLoads:
    """Torque over its limit of every joint or actuator, (J,) a limb; the least load; and what grips do:
    wrenches (limbs, 6) on the robot at the grippers, force [N] and moment [N m], body frame, and pressures (limbs, 2)
    [N] of the fingers.
    """

    load: Load
    shares: list[Array]
    wrenches: Array
    pressures_N: Array


def peak_torques_Nm(limbs: Sequence[Limb]) -> list[Array]:
    """(J,) a limb: of its joints, or of the actuators in their places."""
    return [
        limb.actuators.torque_Nm if limb.actuators else np.array([joint.effort for joint in limb.joints])
        for limb in limbs
    ]


def gravity_b_m_s2(slope_rad: float) -> Array:
    """(3,) of a level robot, whose x goes up a wall of this slope."""
    return GRAVITY_M_S2 * np.array([-np.sin(slope_rad), 0.0, -np.cos(slope_rad)])


def least_load(
    stance: Stance, slope_rad: float, limits_Nm: list[Array], friction: float, most_N: float, lifted: int | None = None
) -> Load | None:
    """On a wall of this slope, limits (J,) a limb; limb number `lifted` is in the air. None: nothing holds it."""
    return _Program(stance, gravity_b_m_s2(slope_rad), limits_Nm, friction, most_N, lifted).least()


def joint_loads(
    stance: Stance, slope_rad: float, limits_Nm: list[Array], friction: float, most_N: float, lifted: int | None = None
) -> JointLoads | None:
    """The same for every joint: of all ways to share the weight that load the busiest joint least, the one with the
    least sum of shares.
    """
    program = _Program(stance, gravity_b_m_s2(slope_rad), limits_Nm, friction, most_N, lifted)
    load = program.least()
    return None if load is None else program.all_joints(load)


class _Program:
    """Rows over what grips do, (n, GRIP grips): balance, limit surfaces, and torques of all joints."""

    def __init__(
        self,
        stance: Stance,
        gravity_m_s2: Array,
        limits_Nm: list[Array],
        friction: float,
        most_N: float,
        lifted: int | None,
    ) -> None:
        limbs = stance.model.limbs
        self._limbs, self._most_N = limbs, most_N
        names = (limb.actuators.names if limb.actuators else [joint.name for joint in limb.joints] for limb in limbs)
        self._names = [name for each in names for name in each]
        self._limits_Nm = np.concatenate(limits_Nm)
        self._grips = [i for i in range(len(limbs)) if i != lifted]
        count = GRIP * len(self._grips)
        self._wrench = np.zeros((len(limbs), 6, count))
        self._torque, own, surfaces = np.zeros((len(self._names), count)), [], []
        begin = 0
        for i, (limb, state) in enumerate(zip(limbs, stance.states, strict=True)):
            own.append(_borne(limb, state, limb.gravity_torque(state, gravity_m_s2[None]))[0])
            rows, begin = slice(begin, begin + len(limb.joints)), begin + len(limb.joints)
            if i not in self._grips:
                continue
            at = slice(GRIP * self._grips.index(i), GRIP * self._grips.index(i) + GRIP)
            forces, moments = _grip(stance.gripper(i)[1])
            self._wrench[i, :, at] = np.vstack([forces.T, moments.T])
            for k, (f, m) in enumerate(zip(forces, moments, strict=True)):
                self._torque[rows, at.start + k] = _borne(limb, state, limb.contact_torque(state, f[None], m[None]))[0]
            surfaces += _limit_surface(friction, at, count)
        self._own, self._surfaces = np.concatenate(own), np.array(surfaces)
        arms = np.array([stance.gripper(i)[0] for i in range(len(limbs))])
        forces, moments = self._wrench[:, :3], self._wrench[:, 3:]
        about = moments + np.cross(arms[:, None], forces.transpose(0, 2, 1)).transpose(0, 2, 1)
        self._balance = np.vstack([forces.sum(axis=0), about.sum(axis=0)])
        weight = stance.model.mass_kg * gravity_m_s2
        self._rest = -np.concatenate([weight, np.cross(stance.model.centre_of_mass(stance.states)[0], weight)])

    def least(self) -> Load | None:
        found = self._solved(self._limits_Nm[:, None], np.inf)
        if found.status != 0:
            return None
        busiest = int(found.slack[: 2 * len(self._names)].argmin()) // 2
        return Load(float(found.x[-1]), self._names[busiest])

    def all_joints(self, load: Load) -> JointLoads | None:
        found = self._solved(np.diag(self._limits_Nm), load.share * (1 + SPARE) + SPARE)
        if found.status != 0:
            return None
        does = found.x[: self._torque.shape[1]]
        shares = (self._torque @ does + self._own) / self._limits_Nm
        ends = np.cumsum([len(limb.joints) for limb in self._limbs])
        pressures = np.zeros((len(self._limbs), 2))
        pressures[self._grips] = does.reshape(-1, GRIP)[:, 3:]
        return JointLoads(load, np.split(shares, ends[:-1]), self._wrench @ does, pressures)

    def _solved(self, limits_Nm: Array, most_share: float) -> OptimizeResult:
        """The least sum of shares (m,) up to `most_share`; a joint's torque is at most limits (joints, m) of them."""
        count, shares = self._torque.shape[1], limits_Nm.shape[1]
        torque = np.repeat(np.hstack([self._torque, np.zeros_like(limits_Nm)]), 2, axis=0)
        torque[1::2] *= -1.0
        torque[:, count:] = -np.repeat(limits_Nm, 2, axis=0)
        bounds = np.repeat(-self._own, 2)
        bounds[1::2] *= -1.0
        rows = np.vstack([torque, np.pad(self._surfaces, ((0, 0), (0, shares)))])
        pressed = [(0.0, self._most_N) if k % GRIP in (3, 4) else (None, None) for k in range(count)]
        return linprog(
            np.repeat([0.0, 1.0], [count, shares]),
            rows,
            np.concatenate([bounds, np.zeros(len(self._surfaces))]),
            np.pad(self._balance, ((0, 0), (0, shares))),
            self._rest,
            [*pressed, *[(0.0, most_share)] * shares],
            method="highs",
        )


def _borne(limb: Limb, state: ChainState, torque_Nm: Array) -> Array:
    return limb.actuators.torques_Nm(state.q_rad, torque_Nm) if limb.actuators else torque_Nm


def _limit_surface(friction: float, at: slice, count: int) -> list[Array]:
    """Rows of both fingers of the grip with these variables."""
    rows = []
    for finger, signs in product((3, 4), product((1.0, -1.0), repeat=3)):
        row = np.zeros(count)
        row[at.start : at.start + 3] = np.array(signs) / [friction, friction, PATCH_K_M * friction]
        row[at.start + finger] = -1.0
        rows.append(row)
    return rows


def _grip(turn: Array) -> tuple[Array, Array]:
    """Forces (5, 3) and moments (5, 3) on the robot of s1, s2, m, n1 and n2 of a gripper with a rotation (3, 3)."""
    opening, across, up = turn.T
    zero = np.zeros(3)
    forces = np.array([2 * across, 2 * up, zero, opening, -opening])
    return forces, np.array([zero, zero, 2 * opening, zero, zero])
