"""Keeps what really happened in physics, for the judge: the runtime never sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crux_tools.sim.plant import CONTACT_PERIOD, FIRST_CONTACT_STEP, Plant

FIRST_ROWS = 8192
# columns of a row
BODY = slice(0, 3)
QUATERNION = slice(3, 7)
GRIPPERS = slice(7, 19)
ROTATIONS = slice(19, 55)
PADS = slice(55, 79)
PAD_FORCE = slice(79, 87)
PAD_FACE = slice(87, 95)
WRENCHES = slice(95, 119)
LINK_FORCE = 119
IS_CLIMBING = 120
COLUMNS = 121

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Truth:
    """Samples of the physics; n of them, limbs LF, RF, LR, RR, pads 1 and 2 of each. Frame W."""

    cycle: Ints  # (n,) control cycle whose step had just been made
    body_position_m: Floats  # (n, 3)
    body_quaternion: Floats  # (n, 4) w, x, y, z
    gripper_position_m: Floats  # (n, 4, 3)
    gripper_rotation: Floats  # (n, 4, 3, 3) W <- gripper
    pad_position_m: Floats  # (n, 8, 3) pad centres
    pad_force_n: Floats  # (n, 8) normal force
    pad_face: Ints  # (n, 8) index into faces, -1 without contact
    hand_wrench_g: Floats  # (n, 4, 6) of the world on the hand incl. its weight, gripper frame, without bias and noise
    link_contact_force_n: Floats  # (n,) greatest force on anything but a pad
    climbing: Bools  # (n,) the runtime said on the bus that it climbs


class Recorder:
    """Takes a sample in the runtime's cycles 1, 6, 11 …, when the plant has just looked at its contacts."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self._rows = np.empty((FIRST_ROWS, COLUMNS))
        self._cycles = np.empty(FIRST_ROWS, dtype=np.int64)
        self._count = 0

    def sample(self, cycle: int, climbing: bool) -> None:
        """Call after every step; `cycle` is the runtime's count, `climbing` its state as the nodes hear it."""
        plant = self.plant
        if cycle % CONTACT_PERIOD != FIRST_CONTACT_STEP - 1:  # the step of cycle 0 is the first
            return
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.empty_like(self._rows)])
            self._cycles = np.concatenate([self._cycles, np.empty_like(self._cycles)])
        row, data, robot = self._rows[self._count], plant.data, plant.robot
        row[BODY] = data.qpos[:3]
        row[QUATERNION] = data.qpos[3:7]
        row[GRIPPERS] = data.site_xpos[robot.gripper_sites].ravel()
        row[ROTATIONS] = data.site_xmat[robot.gripper_sites].ravel()
        row[PADS] = data.geom_xpos[robot.pad_geoms].ravel()
        row[PAD_FORCE] = plant.pad_force_n
        row[PAD_FACE] = plant.pad_face
        row[WRENCHES] = plant.ft_true
        row[LINK_FORCE] = plant.link_contact_force_n
        row[IS_CLIMBING] = climbing
        self._cycles[self._count] = cycle
        self._count += 1

    def truth(self) -> Truth:
        """Everything sampled so far."""
        n, rows = self._count, self._rows[: self._count]
        return Truth(
            cycle=self._cycles[:n].copy(),
            body_position_m=rows[:, BODY].copy(),
            body_quaternion=rows[:, QUATERNION].copy(),
            gripper_position_m=rows[:, GRIPPERS].reshape(n, 4, 3),
            gripper_rotation=rows[:, ROTATIONS].reshape(n, 4, 3, 3),
            pad_position_m=rows[:, PADS].reshape(n, 8, 3),
            pad_force_n=rows[:, PAD_FORCE].copy(),
            pad_face=rows[:, PAD_FACE].astype(np.int64),
            hand_wrench_g=rows[:, WRENCHES].reshape(n, 4, 6),
            link_contact_force_n=rows[:, LINK_FORCE].copy(),
            climbing=rows[:, IS_CLIMBING] > 0,
        )
