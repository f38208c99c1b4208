"""The wall of a plan as MuJoCo geometry: holds and obstacles are boxes, a face may have its own friction and spines.

A box geom has one friction coefficient, so a hold whose faces differ is built from five slabs that meet without
overlap: a pad on a face then touches exactly one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from crux_contracts.scenario import FACE_NAMES, parse_scenario
from numpy.typing import NDArray

SIDE_SLAB_M = 0.010
TOP_SLAB_M = 0.005
HOLD_RGBA = (0.55, 0.50, 0.45, 1.0)
SLIPPERY_RGBA = (0.45, 0.60, 0.70, 1.0)
OBSTACLE_RGBA = (0.45, 0.45, 0.48, 1.0)
WALL_RGBA = (0.76, 0.76, 0.72, 1.0)
WALL_MARGIN_M = 1.0  # of wall shown around the holds


@dataclass(frozen=True)
class Face:
    """One face, or several faces with equal surface, of one hold."""

    hold: int
    """index into plan.holds; -1 for the wall itself"""
    geom: str
    friction: float
    spines: bool


def wall_friction(plan: Any) -> float:
    """Friction coefficient of the wall's own surface, from the scenario the plan carries."""
    return parse_scenario(plan.scenario_yaml, any_robot=True).wall.friction


def _slabs(size_m: NDArray[np.float64]) -> list[tuple[str, NDArray[np.float64], NDArray[np.float64]]]:
    """(face, centre, half sizes) of the five slabs of a box standing on z = 0, in its own frame."""
    x, y, z = size_m / 2
    side = min(SIDE_SLAB_M, x, y)
    top = min(TOP_SLAB_M, z)
    flank_z = z - top / 2
    return [
        ("+x", np.array([x - side / 2, 0, flank_z]), np.array([side / 2, y, flank_z])),
        ("-x", np.array([side / 2 - x, 0, flank_z]), np.array([side / 2, y, flank_z])),
        ("+y", np.array([0, y - side / 2, flank_z]), np.array([max(x - side, 1e-4), side / 2, flank_z])),
        ("-y", np.array([0, side / 2 - y, flank_z]), np.array([max(x - side, 1e-4), side / 2, flank_z])),
        ("top", np.array([0, 0, 2 * z - top / 2]), np.array([x, y, top / 2])),
    ]


def add_wall(spec: mujoco.MjSpec, plan: Any) -> list[Face]:
    """Adds the wall plane, the holds and the obstacles to `spec`; returns every touchable face."""
    world = spec.worldbody
    friction = wall_friction(plan)
    ends = [knot.body_position_w_m[:2] for knot in (plan.knots[0], plan.knots[-1])]
    centres = np.array([hold.position_w_m[:2] for hold in plan.holds] or ends)
    middle = (centres.max(axis=0) + centres.min(axis=0)) / 2
    extent = (centres.max(axis=0) - centres.min(axis=0)) / 2 + WALL_MARGIN_M
    world.add_geom(
        name="wall", type=mujoco.mjtGeom.mjGEOM_PLANE, pos=[*middle, 0], size=[*extent, 0.1], rgba=WALL_RGBA,
        contype=0, conaffinity=1, friction=[friction, 0.005, 0.0001],
    )  # fmt: skip
    faces = [Face(-1, "wall", friction, False)]
    for index, hold in enumerate(plan.holds):
        size_m = np.array(hold.size_m)
        half_yaw = hold.yaw_rad / 2
        body = world.add_body(
            name=f"hold{index}", pos=hold.position_w_m, quat=[np.cos(half_yaw), 0, 0, np.sin(half_yaw)]
        )
        surfaces = set(zip(hold.friction, hold.spines, strict=True))
        one_box = [("", np.array([0, 0, size_m[2] / 2]), size_m / 2)]
        parts = one_box if len(surfaces) == 1 else _slabs(size_m)
        for face, centre, half in parts:
            which = FACE_NAMES.index(face) if face else 0
            friction, spines = float(hold.friction[which]), bool(hold.spines[which])
            rgba = OBSTACLE_RGBA if not hold.graspable else HOLD_RGBA if friction > 0 else SLIPPERY_RGBA
            name = f"hold{index}{face}"
            body.add_geom(
                name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=centre, size=half, rgba=rgba, contype=0, conaffinity=1
            )
            faces.append(Face(index, name, friction, spines))
    return faces
