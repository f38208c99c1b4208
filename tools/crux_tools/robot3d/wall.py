"""The wall of a plan as MuJoCo geometry: holds and obstacles are boxes, a face may have its own friction and spines.

A geom has one friction coefficient, so a hold whose faces differ is built from five slabs that meet without overlap: a
pad on a face then touches exactly one of them. Holds with faces that lean are convex meshes, of the same parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from crux_contracts.scenario import FACE_NAMES
from crux_msgs import hold_t
from numpy.typing import NDArray

from crux_tools.telemetry.rotations import hold_middle, hold_quaternion
from crux_tools.telemetry.surfaces import box_of, pad_shares_of, wall_of

SIDE_SLAB_M = 0.010
TOP_SLAB_M = 0.005
HOLD_RGBA = (0.55, 0.50, 0.45, 1.0)
SLIPPERY_RGBA = (0.45, 0.60, 0.70, 1.0)
OBSTACLE_RGBA = (0.45, 0.45, 0.48, 1.0)
FOOTHOLD_RGBA = (0.35, 0.55, 0.40, 1.0)
FOOTHOLD_M = 0.001  # half the height of the disc that is drawn
WALL_RGBA = (0.76, 0.76, 0.72, 1.0)
WALL = "wall"  # name of the plane; those of slabs add their index
WALL_MARGIN_M = 1.0  # of wall shown around the holds


@dataclass(frozen=True)
class Face:
    """One face, or several faces with equal surface, of one hold."""

    hold: int
    """index into plan.holds; -1 for the wall itself"""
    geom: str
    friction: float
    spines: bool
    share: float = 1.0
    """of a pad that bears on it"""


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


def _corners(size_m: NDArray[np.float64], lean_rad: NDArray[np.float64], height_m: float) -> NDArray[np.float64]:
    """(4, 3) of a hold that stands on z = 0, at a height: going round from +x, +y."""
    inward = height_m * np.tan(lean_rad)
    x, y = size_m[0] / 2 - inward[:2], size_m[1] / 2 - inward[2:]
    places = ((x[0], y[0]), (-x[1], y[0]), (-x[1], -y[1]), (x[0], -y[1]))
    return np.array([[*place, height_m] for place in places])


def _leaning_parts(size_m: NDArray[np.float64], lean_rad: NDArray[np.float64]) -> list[tuple[str, NDArray[np.float64]]]:
    """(face, corners (8, 3)) of the five slabs of such a hold: sides, that end under the top's."""
    top = min(TOP_SLAB_M, size_m[2] / 2)
    foot, under, over = (_corners(size_m, lean_rad, z) for z in (0.0, size_m[2] - top, size_m[2]))
    least = np.abs(under[:, :2]).min()
    parts = [("top", np.vstack([under, over]))]
    for face, (first, last) in {"+x": (3, 0), "-x": (1, 2), "+y": (0, 1), "-y": (2, 3)}.items():
        outer = np.vstack([foot[[first, last]], under[[first, last]]])
        axis = "xy".index(face[1])
        step = np.zeros(3)
        step[axis] = -min(SIDE_SLAB_M, least) if face[0] == "+" else min(SIDE_SLAB_M, least)
        if axis == 1:  # between the slabs of x
            outer[:, 0] += np.where(outer[:, 0] > 0.0, -1.0, 1.0) * min(SIDE_SLAB_M, 0.9 * least)
        parts.append((face, np.vstack([outer, outer + step])))
    return parts


def _add_leaning(spec: mujoco.MjSpec, body: Any, hold: Any, index: int, share: tuple[float, ...]) -> list[Face]:
    """The geoms of a hold with faces that lean."""
    size_m, lean_rad = np.array(hold.size_m), np.array(hold.lean_rad)
    if len(set(zip(hold.friction, hold.spines, share, strict=True))) == 1:
        parts = [("", np.vstack([_corners(size_m, lean_rad, z) for z in (0.0, size_m[2])]))]
    else:
        parts = _leaning_parts(size_m, lean_rad)
    faces = []
    for face, corners in parts:
        which, name = FACE_NAMES.index(face) if face else 0, f"hold{index}{face}"
        friction, spines = float(hold.friction[which]), bool(hold.spines[which])
        spec.add_mesh(name=name, uservert=corners.ravel())
        body.add_geom(
            name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=1,
            rgba=HOLD_RGBA if friction > 0 else SLIPPERY_RGBA,
        )  # fmt: skip
        faces.append(Face(index, name, friction, spines, share[which]))
    return faces


def _draw_foothold(body: Any, foothold: Any, index: int) -> None:
    """A disc that nothing touches: feet stand on the surface."""
    body.add_geom(
        name=f"hold{index}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[foothold.size_m[0], FOOTHOLD_M, 0],
        rgba=FOOTHOLD_RGBA, contype=0, conaffinity=0,
    )  # fmt: skip


def _add_surfaces(world: Any, plan: Any) -> list[Face]:
    """The plane z = 0 around holds and body, and the solids behind bounded surfaces."""
    wall = wall_of(plan)
    geoms = []
    if wall.endless:
        ends = [knot.body_position_w_m[:2] for knot in (plan.knots[0], plan.knots[-1])]
        centres = np.array([hold.position_w_m[:2] for hold in plan.holds] or ends)
        middle = (centres.max(axis=0) + centres.min(axis=0)) / 2
        extent = (centres.max(axis=0) - centres.min(axis=0)) / 2 + WALL_MARGIN_M
        plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "pos": [*middle, 0], "size": [*extent, 0.1]}
        geoms.append((WALL, wall.friction, plane))
    for index, slab in enumerate(wall.slabs):
        box = box_of(slab)
        place = {"pos": hold_middle(box), "quat": hold_quaternion(box), "size": np.array(box.size_m) / 2}
        geoms.append((f"{WALL}{index}", slab.friction, {"type": mujoco.mjtGeom.mjGEOM_BOX, **place}))
    for name, friction, geom in geoms:
        world.add_geom(name=name, rgba=WALL_RGBA, contype=0, conaffinity=1, friction=[friction, 0.005, 0.0001], **geom)
    return [Face(-1, name, friction, False) for name, friction, _ in geoms]


def add_wall(spec: mujoco.MjSpec, plan: Any) -> list[Face]:
    """Adds the surfaces, the holds and the obstacles to `spec`; returns every touchable face."""
    world = spec.worldbody
    faces = _add_surfaces(world, plan)
    for index, (hold, share) in enumerate(zip(plan.holds, pad_shares_of(plan), strict=True)):
        size_m = np.array(hold.size_m)
        body = world.add_body(name=f"hold{index}", pos=hold.position_w_m, quat=hold_quaternion(hold))
        if hold.graspable == hold_t.FOOTHOLD:
            _draw_foothold(body, hold, index)
            continue
        if any(hold.lean_rad):
            faces += _add_leaning(spec, body, hold, index, share)
            continue
        surfaces = set(zip(hold.friction, hold.spines, share, strict=True))
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
            faces.append(Face(index, name, friction, spines, share[which]))
    return faces
