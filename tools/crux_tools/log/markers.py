"""Holds, obstacles, forces and margins as the markers that Foxglove and rviz draw."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_msgs import hold_t

from crux_tools.log.ros2 import Rows, encoded, laid_out, vector
from crux_tools.log.seen import WORLD, Seen
from crux_tools.telemetry.rotations import hold_middle, hold_quaternion, hold_top_m
from crux_tools.telemetry.surfaces import box, box_of, wall_of

CUBE, SPHERE, ARROW, TEXT = 1, 2, 0, 9  # of visualization_msgs/Marker
ADD, DELETE = 0, 2
FORCE_SCALE_M_PER_N = 0.004
SHAFT_M, HEAD_M = 0.008, 0.018
BALL_M = 0.03
TEXT_M = 0.03
TEXT_ABOVE_M = 0.06
WALL_M = 0.002
WALL_BEYOND_M = 0.3  # the wall is drawn so far beyond the outermost hold
HOLD_RGBA, OBSTACLE_RGBA, WALL_RGBA = (0.62, 0.53, 0.42, 1.0), (0.35, 0.35, 0.38, 1.0), (0.80, 0.79, 0.74, 1.0)
TEXT_RGBA = (0.1, 0.1, 0.1, 1.0)
FORCES = {"measured": ("", (0.14, 0.40, 0.69, 1.0)), "planned": ("_reference", (0.90, 0.59, 0.16, 1.0))}
USED_RGB = ((0.0, (0.18, 0.63, 0.35)), (0.7, (0.93, 0.73, 0.15)), (1.0, (0.83, 0.14, 0.14)))  # by share of the surface
NO_MARGIN = "       "


def _marker(ns: str, number: int, kind: int, **more: Any) -> dict[str, Any]:
    upright = {"orientation": vector((0, 0, 0, 1))}
    return {"header": {"frame_id": WORLD}, "ns": ns, "id": number, "type": kind, "pose": upright, **more}


def wall_markers(plan: Any) -> bytes:
    """The MarkerArray of the wall, its holds and obstacles with their names."""
    markers = [
        _cube("wall", number, hold_middle(solid), hold_quaternion(solid), solid.size_m, WALL_RGBA)
        for number, solid in enumerate(_surfaces(plan))
    ]
    for number, hold in enumerate(plan.holds):
        kind, rgba = ("holds", HOLD_RGBA) if hold.graspable else ("obstacles", OBSTACLE_RGBA)
        middle = hold_middle(hold)
        cube = _cube(kind, number, middle, hold_quaternion(hold), hold.size_m, rgba)
        name = _marker("names", number, TEXT, scale=vector((0, 0, TEXT_M)), text=hold.name)
        name |= {
            "pose": {"position": vector((*middle[:2], hold_top_m(hold) + TEXT_M)), "orientation": vector((0, 0, 0, 1))}
        }
        name |= {"color": vector(TEXT_RGBA, "rgba")}
        markers += [cube, name]
    return encoded("visualization_msgs/MarkerArray", {"markers": markers})


def _surfaces(plan: Any) -> list[hold_t]:
    """The solids behind the surfaces; of the plane that part which is around holds and grippers."""
    wall = wall_of(plan)
    boxes = [box_of(slab) for slab in wall.slabs]
    if not wall.endless:
        return boxes
    points = [hold.position_w_m[:2] for hold in plan.holds] + [
        limb.gripper_position_w_m[:2] for knot in plan.knots for limb in knot.limbs
    ]
    low, high = np.min(points, axis=0) - WALL_BEYOND_M, np.max(points, axis=0) + WALL_BEYOND_M
    middle, size = (low + high) / 2, high - low
    return [box((*middle, -WALL_M), (*size, WALL_M)), *boxes]


def _cube(
    kind: str, number: int, middle: np.ndarray, wxyz: np.ndarray, size_m: Any, rgba: tuple[float, ...]
) -> dict[str, Any]:
    """A box in W."""
    w, *xyz = wxyz
    pose = {"position": vector(middle), "orientation": vector((*xyz, w))}
    return _marker(kind, number, CUBE, scale=vector(size_m), color=vector(rgba, "rgba")) | {"pose": pose}


def used_colours(used: np.ndarray) -> np.ndarray:
    """(n, 4) red, green, blue, opacity by the share of the limit surface that a grip uses: red where it slips."""
    shares, channels = [share for share, _ in USED_RGB], np.array([rgb for _, rgb in USED_RGB]).T
    rgb = [np.interp(np.nan_to_num(used, posinf=1.0), shares, channel) for channel in channels]
    return np.stack([*rgb, np.ones_like(used)], axis=-1)


def force_markers(seen: Seen) -> list[bytes]:
    """A MarkerArray a row: arrows of measured and planned forces, balls by the share used, margins in newtons."""
    blank = {"points": [vector((0, 0, 0))] * 2, "scale": vector((SHAFT_M, HEAD_M, 0))}
    arrows = [
        (f"{name}/{limb}", _marker(f"{name}/{limb}", 0, ARROW, color=vector(rgba, "rgba"), **blank))
        for name, (_, rgba) in FORCES.items()
        for limb in LIMB_NAMES
    ]
    balls = [_marker(f"margin/{limb}", 0, SPHERE, scale=vector([BALL_M] * 3)) for limb in LIMB_NAMES]
    texts = [
        _marker(
            f"margin/{limb}", 1, TEXT, scale=vector((0, 0, TEXT_M)), color=vector(TEXT_RGBA, "rgba"), text=NO_MARGIN
        )
        for limb in LIMB_NAMES
    ]
    layout = laid_out(
        "visualization_msgs/MarkerArray", {"markers": [*(marker for _, marker in arrows), *balls, *texts]}
    )
    rows = Rows(layout, len(seen.rows))
    rows.put_stamps([f"markers.{i}.header.stamp" for i in range(len(arrows) + 2 * len(LIMB_NAMES))], seen.times_ns)
    at = seen.log.limbs["gripper_position_w_m"][seen.rows]
    for number, (kind, _) in enumerate(FORCES.values()):
        force = seen.wrench(kind)[..., :3]
        for limb in range(len(LIMB_NAMES)):
            ends = np.concatenate([at[:, limb], at[:, limb] + FORCE_SCALE_M_PER_N * force[:, limb]], axis=1)
            rows.put(f"markers.{number * len(LIMB_NAMES) + limb}.points.0", ends)
    for limb in range(len(LIMB_NAMES)):
        _put_margin(rows, len(arrows) + limb, len(arrows) + len(LIMB_NAMES) + limb, at[:, limb], seen.margin_n[:, limb])
        rows.put(f"markers.{len(arrows) + limb}.color", used_colours(seen.used[:, limb]))
    return rows.payloads()


def _put_margin(rows: Rows, ball: int, text: int, at: np.ndarray, margin_n: np.ndarray) -> None:
    hidden = np.where(np.isnan(margin_n), DELETE, ADD)
    rows.put(f"markers.{ball}.action", hidden)
    rows.put(f"markers.{text}.action", hidden)
    rows.put(f"markers.{ball}.pose.position", at)
    rows.put(f"markers.{text}.pose.position", at + np.array([0, 0, TEXT_ABOVE_M]))
    words = [NO_MARGIN if np.isnan(value) else f"{np.clip(value, -99, 999):5.1f} N" for value in margin_n]
    rows.put_text(f"markers.{text}.text", words)
