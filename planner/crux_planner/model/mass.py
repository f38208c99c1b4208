"""Composite inertia and centre of mass of the whole robot: from its description, or from poses of body and grippers."""

from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.urdf import Joint, Link

from crux_planner.model.arrays import Array
from crux_planner.model.hands import UPRIGHT, rotations
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.limb import LimbMasses, in_reach, numbers_of_all, placed
from crux_planner.model.placed_limb import PlacedLimb, Vector
from crux_planner.model.problem import CentroidalProblem, Problem
from crux_planner.model.workspace import Reach

_GRID, _TILTS = 13, 5  # points along each edge of a box, and of tilts about each axis
_FIT = 5  # the same, where a straight line is laid through them
_YAWS = 9  # of grippers, until a limb reaches
_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def centres_of_mass(problem: CentroidalProblem, poses: Array, hands: Array) -> Array:
    """Places (n, 3) in H for body poses (n, 6) and hands (n, 4, 4 or 6)."""
    to_h, limbs = _limbs_in_body(problem, poses, hands)
    moment = problem.body_moment_kg_m + np.stack(limbs.first_moment(), axis=-1).sum(axis=0)
    return np.asarray(poses[:, :3] + np.einsum("kij,kj->ki", to_h, moment / problem.mass_kg))


def centres_of_pressure(problem: CentroidalProblem, poses: Array, hands: Array, dt_s: float) -> Array:
    """Where (K, 2) on z = 0 the ground's force passes with no moment along it, for poses (K, 6) and grippers (K, 4, 4)
    every `dt_s`: every link a point mass with the second difference of its places, at rest at both ends.
    """
    to_h, limbs = _limbs_in_body(problem, poses, hands)
    masses = np.concatenate([np.ravel(mass) for _, _, mass in limbs.links])
    masses = np.append(masses, problem.mass_kg - masses.sum())
    inside = np.concatenate([np.stack(np.broadcast_arrays(*place), axis=-1) for _, place, _ in limbs.links])
    of_body = np.broadcast_to(problem.body_moment_kg_m / masses[-1], inside[:1].shape)
    places = poses[:, :3] + np.einsum("kij,lkj->lki", to_h, np.concatenate([inside, of_body]))
    pull = np.full_like(places, -problem.gravity_h)
    pull[:, 1:-1] += np.diff(places, 2, axis=1) / dt_s**2
    moment = np.einsum("l,lki->ki", masses, np.cross(places, pull))
    return np.asarray(np.stack([-moment[:, 1], moment[:, 0]], axis=1) / (pull[..., 2].T @ masses)[:, None])


def _limbs_in_body(problem: CentroidalProblem, poses: Array, hands: Array) -> tuple[Array, PlacedLimb]:
    """The body's rotations (n, 3, 3) and, in its frame, all limbs as one: a number of it is an array (4, n)."""
    to_h = rotation_from_rpy(poses[:, 3:])
    x, y, z, yaw = np.moveaxis(hands[..., :4], -1, 0).swapaxes(-1, -2)
    place = np.stack([x, y, z], axis=-1) - poses[:, :3]
    axis = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    turned = None if hands.shape[-1] == UPRIGHT else rotations(hands).swapaxes(0, 1)
    axis = axis if turned is None else turned[..., 0]
    gripper, along = (_parts(np.einsum("kji,lkj->lki", to_h, v)) for v in (place, axis))
    up = _parts(to_h[:, 2]) if turned is None else _parts(np.einsum("kji,lkj->lki", to_h, turned[..., 2]))
    numbers = numbers_of_all(problem.limb_masses, gripper, up, along)
    return to_h, placed(numbers, in_reach(numbers, gripper, up), up, along)


def linear_centre(problem: Problem) -> tuple[Array, Array]:
    """(3, 3) A and (3,) b: the centre of mass of a level body is off its origin by about A @ p + b, p the mean of
    where its grippers are off it; in the body frame.

    Least squares over where (9a) lets each gripper be, with one slope for all limbs.
    """
    unit = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, _FIT)] * 3, indexing="ij")).reshape(3, -1)
    rest, ways, found = problem.body_moment_kg_m / problem.mass_kg, np.zeros((3, 0)), np.zeros((3, 0))
    ends = []
    for limb, middle in zip(problem.limb_masses, problem.boxes.centre_b_m, strict=False):
        place = middle[:, None] + problem.boxes.half_m[:, None] * unit
        moment = _first_moment(limb, place, problem.gripper_yaw_rad) / problem.mass_kg
        known = ~np.isnan(moment).any(axis=0)
        place, moment = place[:, known], moment[:, known]
        ends.append((place.mean(axis=1), moment.mean(axis=1)))
        ways = np.hstack([ways, place - ends[-1][0][:, None]])
        found = np.hstack([found, moment - ends[-1][1][:, None]])
    slope = found @ np.linalg.pinv(ways) if ends else np.zeros((3, 3))
    for place, moment in ends:
        rest = rest + moment - slope @ place
    return len(ends) * slope, rest


def _first_moment(limb: LimbMasses, place: Array, yaw_rad: tuple[float, float]) -> Array:
    """(3, n) [kg m] of a limb with upright grippers at places (3, n), body frame, NaN where they are out of reach: at
    the yaw nearest to 0 at which any is within.
    """
    at = place[0], place[1], place[2]
    for yaw in sorted(np.linspace(*yaw_rad, _YAWS), key=abs):
        along = float(np.cos(yaw)), float(np.sin(yaw)), 0.0
        with np.errstate(invalid="ignore"):
            moment = np.stack(placed(limb.at(at, _Z, along, np.nan), at, _Z, along).first_moment())
        if not np.isnan(moment).all():
            break
    return moment


def gripper_spans(problem: Problem) -> tuple[Array, Array]:
    """`level_spans` of grippers within `boxes`, and of those that swing above them."""
    return level_spans(problem.boxes, problem.gripper_height_m, problem.body.max_tilt_rad)


def level_spans(reach: Reach, height_m: tuple[float, float], tilt_rad: float) -> tuple[Array, Array]:
    """Bounds (4, 3), (4, 3) in the axes of the body's heading of grippers within a reach, off the body's origin, with
    heights off it within `height_m`, for any tilt.

    With u in the body's axes and q in these, q_x = (u_x + sin(pitch) q_z) / cos(pitch) and
    q_y = (u_y - sin(roll) (sin(pitch) q_x + cos(pitch) q_z)) / cos(roll).
    """
    s, c = np.sin(tilt_rad), np.cos(tilt_rad)
    far = np.abs(reach.centre_b_m) + reach.half_m
    up = np.abs(np.array(height_m) + reach.above_m).max()
    x = ((1.0 - c) * far[:, 0] + s * up) / c
    y = ((1.0 - c) * far[:, 1] + s * (s * (far[:, 0] + x) + up)) / c
    flat = reach.half_m[:2] + np.column_stack([x, y])
    centre, (lowest, highest) = reach.centre_b_m[:, :2], height_m
    return np.insert(centre - flat, 2, lowest, axis=1), np.insert(centre + flat, 2, highest, axis=1)


def offset_bounds(
    problem: CentroidalProblem, spans: tuple[Array, Array], yaw_rad: float, follow: float = 0.0
) -> tuple[Array, Array]:
    """Bounds (3,), (3,) along H's axes of the centre of mass off the body's origin, less `follow` times where the
    grippers are off it: for grippers within `spans` (`gripper_spans`) as far as limbs reach, any tilt, headings of up
    to `yaw_rad` to either side.
    """
    tilt, moment = problem.body.max_tilt_rad, problem.body_moment_kg_m
    leaning = 2 * tilt * np.linalg.norm(moment)
    total = np.array([moment - leaning, moment + leaning])
    for limb, low, high in zip(problem.limb_masses, *spans, strict=True):
        total += moment_bounds(limb, low, high, tilt, follow * problem.mass_kg)
    low, high = total / problem.mass_kg
    return yawed_bounds(low, high, yaw_rad)


def moment_bounds(limb: LimbMasses, low: Array, high: Array, tilt_rad: float, follow_kg: float = 0.0) -> Array:
    """Bounds (2, 3) in the axes of the body's heading of a limb's first moment, less `follow_kg` times its gripper's
    place, for grippers within [low, high] as far as it reaches, and tilts up to `tilt_rad`.
    """
    return _moment_bounds(tuple(limb.numbers), tuple(low), tuple(high), tilt_rad, follow_kg).copy()


@lru_cache(maxsize=64)
def _moment_bounds(
    numbers: tuple[float, ...], low: tuple[float, ...], high: tuple[float, ...], tilt_rad: float, follow_kg: float
) -> Array:
    """The extremes over a grid, each wider by what lies between its points."""
    edges = [np.linspace(*ends, _GRID) for ends in zip(low, high, strict=True)]
    tilts = np.linspace(-tilt_rad, tilt_rad, _TILTS)
    x, y, z, roll, pitch = np.meshgrid(*edges, tilts, tilts, indexing="ij", sparse=True)
    (cr, sr), (cp, sp) = ((np.cos(angle), np.sin(angle)) for angle in (roll, pitch))

    def in_body(v: Vector) -> Vector:
        along, up = cp * v[0] - sp * v[2], sp * v[0] + cp * v[2]
        return along, cr * v[1] + sr * up, cr * up - sr * v[1]

    # the opening axis is that of a gripper at heading 0: what turns it moves the hand's mass alone
    with np.errstate(invalid="ignore"):
        along, side, up = placed(np.array(numbers), in_body((x, y, z)), in_body(_Z), in_body(_X)).first_moment()
    up, side = sr * side + cr * up, cr * side - sr * up
    level = cp * along + sp * up, side, cp * up - sp * along
    found = np.stack(np.broadcast_arrays(*level)) - follow_kg * np.stack(np.broadcast_arrays(x, y, z, roll, pitch)[:3])
    order = 1 if np.isnan(found).any() else 2  # what bends between the points, or all where the reach ends there
    every = tuple(range(1, 6))
    most = [np.nanmax(np.abs(np.diff(found, order, axis=axis)), axis=every) for axis in every]
    rest = np.sum(most, axis=0) / (8 if order == 2 else 2)
    rest += numbers[-1] * np.hypot(numbers[-4], numbers[-3])  # the hand's
    return np.array([np.nanmin(found, axis=every) - rest, np.nanmax(found, axis=every) + rest])


def in_heading(low: Array, high: Array, yaw_rad: tuple[float, float]) -> tuple[Array, Array]:
    """Bounds (3,), (3,) along the axes of a heading within `yaw_rad` of a vector within bounds along H's."""
    back = rotation_z(-(yaw_rad[0] + yaw_rad[1]) / 2)
    middle, half = back @ (low + high) / 2, np.abs(back) @ (high - low) / 2
    return yawed_bounds(middle - half, middle + half, (yaw_rad[1] - yaw_rad[0]) / 2)


def yawed_bounds(low: Array, high: Array, yaw_rad: float) -> tuple[Array, Array]:
    """Of a vector turned about z by up to `yaw_rad` to either side."""
    reach = np.maximum(np.abs(low), np.abs(high))
    reach[2], flat = 0.0, np.array([*2 * [np.hypot(reach[0], reach[1])], np.inf])
    more = np.sin(min(yaw_rad, np.pi / 2)) * reach[[1, 0, 2]] + (1.0 - np.cos(min(yaw_rad, np.pi))) * reach
    return np.maximum(low - more, -flat), np.minimum(high + more, flat)


def _parts(v: Any) -> Vector:
    return v[..., 0], v[..., 1], v[..., 2]


def composite_inertia(robot: Robot, positions: dict[str, float]) -> Array:
    """(3, 3) about the centre of mass, in the body's axes, at joint positions by name (rad or m)."""
    placed_links = list(_placed_links(robot, positions))
    total = -_point_mass(robot.total_mass_kg, _mean_place(robot, placed_links))
    for link, origin, rotation in placed_links:
        total += _about_origin(link, origin, rotation)
    return total


def centre_of_mass(robot: Robot, positions: dict[str, float]) -> Array:
    """(3,) in the body frame, at joint positions by name (rad or m)."""
    return _mean_place(robot, _placed_links(robot, positions))


def _mean_place(robot: Robot, placed_links: Iterable[tuple[Link, Array, Array]]) -> Array:
    """(3,) of the robot's mass, in the body frame."""
    moment = np.zeros(3)
    for link, origin, rotation in placed_links:
        moment += link.mass_kg * (origin + rotation @ np.array(link.com_m))
    return np.asarray(moment / robot.total_mass_kg)


def body_moment(robot: Robot) -> Array:
    """(3,) mass times place of the body link's centre of mass, in its frame."""
    body = robot.urdf.links[robot.body_link]
    return body.mass_kg * np.array(body.com_m)


def _placed_links(robot: Robot, positions: dict[str, float]) -> Iterator[tuple[Link, Array, Array]]:
    """Every link with its origin and rotation in the body frame."""
    children: dict[str, list[Joint]] = {}
    for joint in robot.urdf.joints.values():
        children.setdefault(joint.parent, []).append(joint)
    open_links = [(robot.body_link, np.zeros(3), np.eye(3))]
    while open_links:
        name, origin, rotation = open_links.pop()
        yield robot.urdf.links[name], origin, rotation
        for joint in children.get(name, []):
            open_links.append((joint.child, *_place(joint, positions.get(joint.name, 0.0), origin, rotation)))


def _place(joint: Joint, position: float, origin: Array, rotation: Array) -> tuple[Array, Array]:
    """Where a joint at `position` puts its child link."""
    at = origin + rotation @ np.array(joint.xyz_m)
    turned = rotation @ rotation_from_rpy(np.array(joint.rpy_rad))
    axis = np.array(joint.axis)
    if joint.kind == "prismatic":
        return at + turned @ axis * position, turned
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return at, turned @ (np.eye(3) + np.sin(position) * cross + (1.0 - np.cos(position)) * cross @ cross)


def _about_origin(link: Link, origin: Array, rotation: Array) -> Array:
    xx, xy, xz, yy, yz, zz = link.inertia_kg_m2
    own: Array = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    own += _point_mass(link.mass_kg, origin + rotation @ np.array(link.com_m))
    return own


def _point_mass(mass_kg: float, place: Array) -> Array:
    """Inertia about the origin of a mass at a place (3,)."""
    return np.asarray(mass_kg * (place @ place * np.eye(3) - np.outer(place, place)))
