"""What torques a robot needs to hang still on a wall: the least load of its busiest joint, over how grips share it.

A grip presses with both fingers along its opening axis, shares two shear forces and a twist about that axis between
them, and holds what is inside |s1| / mu + |s2| / mu + |m| / (k mu) <= n of each finger: inside the limit surface (2).
A linear program with variables s1, s2, m, n1, n2 of every gripping limb, and the load.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from crux_contracts.scenario_types import GRAVITY_M_S2
from numpy.typing import NDArray
from scipy.optimize import linprog

from crux_tools.robot.stance import Stance

Array = NDArray[np.float64]
PATCH_K_M = 2 / 3 * 0.02  # twist of a contact patch of 2 cm, as scenarios have it


@dataclass(frozen=True)
class Load:
    """Of the busiest joint: torque over its limit, and its name; None: no forces hold the robot."""

    share: float
    joint: str


def least_load(
    stance: Stance, slope_rad: float, limits_Nm: list[Array], friction: float, most_N: float, lifted: int | None = None
) -> Load | None:
    """On a wall of this slope, limits (J,) a limb; limb number `lifted` is in the air."""
    gravity = GRAVITY_M_S2 * np.array([[-np.sin(slope_rad), 0.0, -np.cos(slope_rad)]])
    limbs, grips = stance.model.limbs, [i for i in range(len(stance.model.limbs)) if i != lifted]
    count = 5 * len(grips) + 1
    balance, rows, bounds, names = np.zeros((6, count)), [], [], []
    for i, (limb, state) in enumerate(zip(limbs, stance.states, strict=True)):
        own = limb.gravity_torque(state, gravity)[0]
        by = np.zeros((len(own), count))
        if i in grips:
            at = 5 * grips.index(i)
            forces, moments = _grip(stance.yaws_rad[i])
            balance[:3, at : at + 5] = forces.T
            balance[3:, at : at + 5] = (np.cross(stance.grippers_m[i], forces) + moments).T
            by[:, at : at + 5] = np.column_stack(
                [limb.contact_torque(state, f[None], m[None])[0] for f, m in zip(forces, moments, strict=True)]
            )
            for finger, signs in product((3, 4), product((1.0, -1.0), repeat=3)):
                row = np.zeros(count)
                row[at : at + 3] = np.array(signs) / [friction, friction, PATCH_K_M * friction]
                row[at + finger] = -1.0
                rows.append(row)
                bounds.append(0.0)
        for j, sign in product(range(len(own)), (1.0, -1.0)):
            row = sign * by[j]
            row[-1] = -limits_Nm[i][j]
            rows.append(row)
            bounds.append(-sign * own[j])
            names.append((len(rows) - 1, limb.joints[j].name))
    weight = stance.model.mass_kg * gravity[0]
    rest = -np.concatenate([weight, np.cross(stance.model.centre_of_mass(stance.states)[0], weight)])
    limits = [(0.0, most_N) if k % 5 in (3, 4) else (None, None) for k in range(count - 1)] + [(0.0, None)]
    goal = np.eye(count)[-1]
    found = linprog(goal, np.array(rows), np.array(bounds), balance, rest, limits, method="highs")
    if found.status != 0:
        return None
    busiest = min(names, key=lambda each: float(found.slack[each[0]]))
    return Load(float(found.x[-1]), busiest[1])


def _grip(yaw_rad: float) -> tuple[Array, Array]:
    """Forces (5, 3) and moments (5, 3) on the robot of s1, s2, m, n1 and n2 of a grip, body frame."""
    opening = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    across, up = np.array([-opening[1], opening[0], 0.0]), np.array([0.0, 0.0, 1.0])
    zero = np.zeros(3)
    forces = np.array([2 * across, 2 * up, zero, opening, -opening])
    return forces, np.array([zero, zero, 2 * opening, zero, zero])
