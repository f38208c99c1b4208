"""What really happened in physics, for the judge: the runtime never sees it."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crux_simulation.sim.native import library
from crux_simulation.sim.plant import Plant

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
    climbing: Ints  # (n,) 1 where the runtime said on the bus that it climbs, -1 in reverse, else 0


def recorded(plant: Plant) -> Truth:
    """Every sample that the plant has kept: in the runtime's cycles 1, 6, 11 …, when it had looked at its contacts."""
    count = ctypes.c_int64()
    rows = library().crux_plant_recorded(plant.handle, ctypes.byref(count))
    n = count.value
    table = np.ctypeslib.as_array(rows, (n,)).copy()
    return Truth(
        cycle=table["cycle"],
        body_position_m=table["body_position_m"],
        body_quaternion=table["body_quaternion"],
        gripper_position_m=table["gripper_position_m"],
        gripper_rotation=table["gripper_rotation"].reshape(n, 4, 3, 3),
        pad_position_m=table["pad_position_m"],
        pad_force_n=table["pad_force_n"],
        pad_face=table["pad_face"],
        hand_wrench_g=table["hand_wrench_g"],
        link_contact_force_n=table["link_contact_force_n"],
        climbing=table["climbing"],
    )
