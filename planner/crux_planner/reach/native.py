"""ctypes binding of libcrux_reach.so: maps and links of arm.py, compiled (planner/native/reach.h says more)."""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Sequence
from ctypes import POINTER, c_double, c_int64, c_uint8
from functools import cache
from typing import Any

import numpy as np
from crux_contracts.compiled import doubles, flags, integers, needed_library, shared_library
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.sector import Sector
from crux_planner.reach.solids import Box as Cuboid
from crux_planner.reach.solids import Links, Solids

NAME = "libcrux_reach.so"
AXES = 6  # of poses
ANY_SIDE = Sector(0.0, 0.0, 0.0)  # where it is of no interest


class _Sector(ctypes.Structure):
    """crux_reach_sector."""

    _fields_ = [(name, c_double) for name in ("cos_middle", "sin_middle", "cos_half")]


class Box(ctypes.Structure):
    """crux_reach_box."""

    _fields_ = [("centre_m", c_double * 3), ("rotation", c_double * 9), ("half_m", c_double * 3)]


class Capsule(ctypes.Structure):
    """crux_reach_capsule."""

    _fields_ = [("start_m", c_double * 3), ("end_m", c_double * 3), ("radius_m", c_double), ("frame", c_int64)]


class Arm(ctypes.Structure):
    """crux_reach_arm: it keeps its arrays alive."""

    _fields_ = [
        ("shoulder_m", c_double * 3),
        *((name, c_double) for name in ("upper_m", "lower_m", "wrist_to_gripper_m", "least_radius_m")),
        *((name, c_double * 2) for name in ("cos_elbow", "sin_roll")),
        *((name, _Sector) for name in ("azimuth", "upper", "pitch")),
        ("clear_m", c_double),
        ("trunk", POINTER(Box)),
        ("links", POINTER(Capsule)),
        *((name, c_int64) for name in ("boxes", "capsules", "all_capsules")),
    ]


class _Capsules(ctypes.Structure):
    """crux_reach_capsules."""

    _fields_ = [
        *((name, POINTER(c_double)) for name in ("starts", "ends", "radius_m")),
        ("hand", POINTER(c_uint8)),
        ("count", c_int64),
    ]


class Poses(ctypes.Structure):
    """crux_reach_poses."""

    _fields_ = [("values", POINTER(c_double) * 12), ("strides", (c_int64 * AXES) * 12), ("shape", c_int64 * AXES)]


@cache
def library() -> ctypes.CDLL | None:
    """None where it has not been built: numpy gives the same answers."""
    loaded = shared_library(NAME)
    if loaded is not None:
        loaded.crux_reach.restype = None
        loaded.crux_reach.argtypes = [POINTER(Arm), POINTER(Poses), POINTER(c_uint8)]
        loaded.crux_reach_parts.restype = c_int64
        loaded.crux_reach_parts.argtypes = [c_int64, POINTER(c_int64), POINTER(c_uint8), POINTER(c_int64)]
        loaded.crux_reach_links.restype = None
        loaded.crux_reach_links.argtypes = [POINTER(Arm), POINTER(Poses), POINTER(c_double), POINTER(c_double)]
        loaded.crux_reach_apart.restype = None
        two = [POINTER(_Capsules), POINTER(_Capsules)]
        loaded.crux_reach_apart.argtypes = [*two, c_int64, c_double, c_int64, POINTER(c_uint8)]
        loaded.crux_reach_off_boxes.restype = None
        placed = POINTER(c_double), POINTER(c_double), POINTER(Box), c_int64, c_double, POINTER(c_uint8)
        loaded.crux_reach_off_boxes.argtypes = [two[0], c_int64, *placed]
    return loaded


def arm(
    limb: Limb,
    least_radius_m: float,
    cos_elbow: tuple[float, float],
    sin_roll: tuple[float, float],
    sectors: tuple[Sector, Sector, Sector],
    keep_off: Solids,
    clear_m: float,
) -> Arm:
    """A limb with least and most of two joints and the sectors of azimuth, joint 2 and joint 4."""
    boxes = _boxes(keep_off.trunk)
    shapes = (*keep_off.links, *keep_off.first)
    capsules = [Capsule(numbers(c.start_m), numbers(c.end_m), c.radius_m, c.frame) for c in shapes]
    return Arm(
        numbers(limb.shoulder_b_m),
        *(limb.upper_link_m, limb.lower_link_m, limb.wrist_to_gripper_m, least_radius_m),
        *(numbers(np.array(each)) for each in (cos_elbow, sin_roll)),
        *(_sector(each) for each in sectors),
        clear_m,
        boxes,
        (Capsule * len(capsules))(*capsules),
        len(boxes),
        len(keep_off.links),
        len(capsules),
    )


def reaches(compiled: ctypes.CDLL, limb: Arm, poses: GripperPoses, side: Sector) -> Flags:
    """Which poses, of up to six axes, are reached; `side` is the sector of joint 6 for their yaws."""
    seen, whole, _kept = given(poses, side)
    found = np.empty(whole, dtype=np.bool_)
    compiled.crux_reach(limb, seen, flags(found))
    return found.reshape(poses.shape)


def parts(mask: Flags) -> tuple[Indices, int]:
    """Connected parts of the cells of a grid: the number of each cell's part, and how many there are.
    FileNotFoundError where the library has not been built.
    """
    compiled, cells = library() or needed_library(NAME), np.ascontiguousarray(mask)
    numbers, shape = np.empty(mask.shape, dtype=np.int64), np.array(mask.shape, dtype=np.int64)
    count = compiled.crux_reach_parts(mask.ndim, integers(shape), flags(cells), integers(numbers))
    return numbers, int(count)


def links(compiled: ctypes.CDLL, limb: Arm, poses: GripperPoses) -> tuple[Array, Array]:
    """Both ends (..., P, 3) of all capsules at poses of up to six axes, in the body frame."""
    seen, whole, _kept = given(poses, ANY_SIDE)
    start, end = (np.empty((*whole, limb.all_capsules, 3)) for _ in range(2))
    compiled.crux_reach_links(limb, seen, doubles(start), doubles(end))
    shape = *poses.shape, limb.all_capsules, 3
    return start.reshape(shape), end.reshape(shape)


def apart(compiled: ctypes.CDLL, first: Links, second: Links, clear_m: float, hands: bool) -> Flags:
    """(n,) where two limbs keep their links (n, P, 3) off each other, as `between.apart`."""
    one, two = _capsules(first), _capsules(second)
    found = np.empty(len(first.start_m), dtype=np.bool_)
    compiled.crux_reach_apart(one, two, len(found), clear_m, hands, flags(found))
    return found


def off_boxes(links: Links, origins_m: Array, axes: Array, solids: Sequence[Cuboid], clear_m: float) -> Flags:
    """(n,) where a limb's links (n, P, 3), its gripper's left out, keep off boxes by so much, with the body's origin at
    (n, 3) and its axes the columns of (n, 3, 3), both as the boxes are.

    FileNotFoundError where the library has not been built.
    """
    origins, turned = (np.ascontiguousarray(each, dtype=float) for each in (origins_m, axes))
    found = np.empty(len(origins), dtype=np.bool_)
    given = len(origins), doubles(origins), doubles(turned), _boxes(solids), len(solids), clear_m, flags(found)
    (library() or needed_library(NAME)).crux_reach_off_boxes(_capsules(links), *given)
    return found


def _boxes(solids: Sequence[Cuboid]) -> Any:
    boxes = [Box(numbers(each.centre_m), numbers(each.rotation), numbers(each.half_m)) for each in solids]
    return (Box * len(boxes))(*boxes)


def _capsules(links: Links) -> _Capsules:
    """It keeps its arrays alive."""
    parts = [np.ascontiguousarray(part) for part in (links.start_m, links.end_m, links.radius_m)]
    hand = np.ascontiguousarray(links.hand, dtype=np.bool_)
    made = _Capsules(*map(doubles, parts), flags(hand), len(hand))
    made.kept = parts, hand
    return made


def given(poses: GripperPoses, side: Sector) -> tuple[Poses, tuple[int, ...], list[Array]]:
    """As the compiled part has them, their shape of six axes, and the memory that is to be kept meanwhile. An array is
    not copied along axes that it lacks: its stride there is 0.
    """
    shape = poses.shape
    x, y, z, yaw, roll, pitch = poses.arrays
    turns = [turn for angle in (roll, pitch, yaw) for turn in (np.cos(angle), np.sin(angle))]
    inputs = [x, y, z, *turns, side.cos_middle, side.sin_middle, side.cos_half]
    kept = [np.asarray(each, dtype=float) for each in inputs]
    if np.broadcast(*kept).shape != shape:
        raise ValueError(f"sectors of joint 6 for poses {shape}: expected one each, or one for all")
    whole = (1,) * (AXES - len(shape)) + shape
    numbers = array("q", [each.__array_interface__["data"][0] for each in kept])
    for each in kept:
        numbers.extend((0,) * (AXES - each.ndim))
        numbers.extend(
            0 if size == 1 else step // each.itemsize for size, step in zip(each.shape, each.strides, strict=True)
        )
    numbers.extend(whole)
    return Poses.from_buffer(numbers), whole, kept


def _sector(sector: Sector) -> _Sector:
    return _Sector(*(float(each) for each in (sector.cos_middle, sector.sin_middle, sector.cos_half)))


def numbers(values: Array) -> Any:
    flat = np.asarray(values, dtype=float).reshape(-1)
    return (c_double * len(flat))(*flat)
