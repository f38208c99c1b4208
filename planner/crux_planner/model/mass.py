"""Composite inertia and centre of mass of the whole robot: from its description, or from poses of body and grippers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.urdf import Joint, Link

from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.limb import Vector, combined, placed

if TYPE_CHECKING:
    from crux_planner.model.problem import CentroidalProblem, Problem

_STEP = 1e-30  # of complex differentiation: exact to rounding
_STRETCHED = 0.999  # of a limb's links end to end
_GRID = 17  # points along each edge of a box
_FIT = 5  # the same, where a straight line is laid through them
_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def centre_in_body(problem: CentroidalProblem, up: Vector, hands: list[tuple[Vector, Vector]]) -> Vector:
    """Centre of mass of the whole robot with its grippers upright on the wall: their z axis `up`, and the centre and
    opening axis of each; all in the body frame, of whatever numbers model.limb takes.
    """
    x, y, z = problem.body_moment_kg_m.tolist()
    total: Vector = (x, y, z)
    for limb, (gripper, along) in zip(problem.limb_masses, hands, strict=True):
        total = combined((1.0, total), (1.0, placed(limb, gripper, up, along).first_moment()))
    return combined((1.0 / problem.mass_kg, total))


def centres_of_mass(problem: CentroidalProblem, poses: Array, hands: Array) -> Array:
    """Places (..., 3) in W for body poses (..., 6), complex too, and grippers (..., 4, 4): centre and yaw of each."""
    to_w, up, held = _in_body(problem, poses, hands)
    centre = np.stack(centre_in_body(problem, up, held), axis=-1)
    found: Array = poses[..., :3] + np.einsum("...ij,...j->...i", to_w, centre)
    return found


def centres_of_pressure(problem: CentroidalProblem, poses: Array, hands: Array) -> Array:
    """Where (K, 2) on z = 0 the ground's force passes with no moment along it, for poses (K, 6) and grippers (K, 4, 4)
    at knots: every link a point mass with the second difference of its places, at rest at both ends.
    """
    to_w, up, held = _in_body(problem, poses, hands)
    placed_limbs = (
        placed(limb, gripper, up, along) for limb, (gripper, along) in zip(problem.limb_masses, held, strict=True)
    )
    links = [(place, mass) for limb in placed_limbs for _, place, mass in limb.links]
    of_body = problem.mass_kg - sum(mass for _, mass in links)
    x, y, z = (np.full(len(poses), each) for each in problem.body_moment_kg_m / of_body)
    links.append(((x, y, z), of_body))
    masses = np.array([mass for _, mass in links])
    places = poses[:, :3] + np.einsum(
        "kij,ljk->lki", to_w, np.array([np.broadcast_arrays(*place) for place, _ in links])
    )
    pull = np.full_like(places, -problem.gravity_w)
    pull[:, 1:-1] += np.diff(places, 2, axis=1) / problem.dt_s**2
    moment = np.einsum("l,lki->ki", masses, np.cross(places, pull))
    found: Array = np.stack([-moment[:, 1], moment[:, 0]], axis=1) / (pull[..., 2].T @ masses)[:, None]
    return found


def _in_body(
    problem: CentroidalProblem, poses: Array, hands: Array
) -> tuple[Array, Vector, list[tuple[Vector, Vector]]]:
    """The body's rotations, and in its frame the wall's normal and each gripper's centre and opening axis: no farther
    than a stretched limb has it, since motions that programs begin with may ask for more.
    """
    to_w = rotation_from_rpy(poses[..., 3:])
    to_b = to_w.swapaxes(-1, -2)
    places = np.einsum("...ij,...lj->l...i", to_b, hands[..., :3] - poses[..., None, :3])
    axes = np.stack([np.cos(hands[..., 3]), np.sin(hands[..., 3]), np.zeros_like(hands[..., 3])], axis=-1)
    axes = np.einsum("...ij,...lj->l...i", to_b, axes)
    for i, limb in enumerate(problem.limb_masses):
        away = places[i] + limb.limb.wrist_to_gripper_m * to_b[..., 2] - limb.limb.shoulder_b_m
        most = _STRETCHED * (limb.limb.upper_link_m + limb.limb.lower_link_m)
        places[i] -= np.maximum(1.0 - most / np.linalg.norm(away.real, axis=-1, keepdims=True), 0.0) * away
    held = [(_parts(place), _parts(axis)) for place, axis in zip(places, axes, strict=True)]
    return to_w, _parts(to_b[..., 2]), held


def centres_and_slopes(problem: CentroidalProblem, poses: Array, hands: Array) -> tuple[Array, Array]:
    """`centres_of_mass` (n, 3) of poses (n, 6), and their derivatives (n, 3, 6) by the poses."""
    moved = poses + 1j * _STEP * np.eye(6)[:, None]
    found = centres_of_mass(problem, moved, np.broadcast_to(hands, (6, *hands.shape)))
    return found[0].real, found.imag.transpose(1, 2, 0) / _STEP


def linear_centre(problem: CentroidalProblem) -> tuple[Array, Array]:
    """(3, 3) A and (3,) b: the centre of mass of a level body is off its origin by about A @ p + b, p the mean of
    where its grippers are off it; in the body frame.

    Least squares over where (9a) lets each gripper be, with one slope for all limbs.
    """
    unit = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, _FIT)] * 3, indexing="ij")).reshape(3, -1)
    rest, ways, found = problem.body_moment_kg_m / problem.mass_kg, np.zeros((3, 0)), np.zeros((3, 0))
    ends = []
    for limb, middle in zip(problem.limb_masses, problem.boxes.centre_b_m, strict=False):
        place = middle[:, None] + problem.boxes.half_m[:, None] * unit
        with np.errstate(invalid="ignore"):
            moment = np.stack(placed(limb, (place[0], place[1], place[2]), _Z, _X).first_moment()) / problem.mass_kg
        known = ~np.isnan(moment).any(axis=0)
        place, moment = place[:, known], moment[:, known]
        ends.append((place.mean(axis=1), moment.mean(axis=1)))
        ways = np.hstack([ways, place - ends[-1][0][:, None]])
        found = np.hstack([found, moment - ends[-1][1][:, None]])
    slope = found @ np.linalg.pinv(ways) if ends else np.zeros((3, 3))
    for place, moment in ends:
        rest = rest + moment - slope @ place
    return len(ends) * slope, rest


def gripper_spans(problem: Problem) -> tuple[Array, Array]:
    """Bounds (4, 3), (4, 3) in the body frame of grippers within `boxes`, and of those that swing above them."""
    reach, top = problem.boxes, problem.limb_reach.box
    high = reach.centre_b_m + reach.half_m
    high[:, 2] = np.maximum(high[:, 2], top.centre_b_m[:, 2] + top.half_m[2])
    return reach.centre_b_m - reach.half_m, high


def offset_bounds(
    problem: CentroidalProblem, spans: tuple[Array, Array], yaw_rad: float, follow: float = 0.0
) -> tuple[Array, Array]:
    """Bounds (3,), (3,) along W's axes of the centre of mass off the body's origin, less `follow` times where the
    grippers are off it: for grippers within `spans` as far as limbs reach, any tilt, headings of up to `yaw_rad` to
    either side.

    The extremes over a grid, each wider by what lies between its points.
    """
    steps = np.linspace(0.0, 1.0, _GRID)
    unit = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"))
    total = np.array([problem.body_moment_kg_m, problem.body_moment_kg_m])
    for limb, start, end in zip(problem.limb_masses, *spans, strict=True):
        place = start[:, None, None, None] + (end - start)[:, None, None, None] * unit
        # the gripper's axes as a level body at heading 0 has them: what turns it moves the hand's mass alone
        with np.errstate(invalid="ignore"):
            moment = placed(limb, (place[0], place[1], place[2]), _Z, _X).first_moment()
        found = np.stack(np.broadcast_arrays(*moment)) - follow * problem.mass_kg * place
        order = 1 if np.isnan(found).any() else 2  # what bends between the points, or all where the reach ends there
        most = [np.nanmax(np.abs(np.diff(found, order, axis=1 + i)), axis=(1, 2, 3)) for i in range(3)]
        rest = np.sum(most, axis=0) / (8 if order == 2 else 2)
        rest += limb.limb.hand_mass_kg * np.hypot(*limb.limb.hand_com_g_m[:2])
        leaning = limb.limb.wrist_to_gripper_m * np.sin(problem.body.max_tilt_rad)  # of the wrist above the gripper
        rest += (limb.limb.hand_mass_kg + follow * problem.mass_kg) * leaning
        total += [np.nanmin(found, axis=(1, 2, 3)) - rest, np.nanmax(found, axis=(1, 2, 3)) + rest]
    low, high = total / problem.mass_kg
    return turned_bounds(low, high, problem.body.max_tilt_rad, yaw_rad)


def turned_bounds(low: Array, high: Array, tilt_rad: float, yaw_rad: float) -> tuple[Array, Array]:
    """Bounds (3,), (3,) along W's axes of a vector within bounds along the body's, for any tilt and heading up to
    these.
    """
    return _yawed_bounds(*_tilted_bounds(low, high, tilt_rad), yaw_rad)


def bounds_in_body(low: Array, high: Array, tilt_rad: float, yaw_rad: tuple[float, float]) -> tuple[Array, Array]:
    """Bounds (3,), (3,) along the body's axes of a vector within bounds along W's, for any tilt up to `tilt_rad` and
    headings within `yaw_rad`.
    """
    back = rotation_z(-(yaw_rad[0] + yaw_rad[1]) / 2)
    middle, half = back @ (low + high) / 2, np.abs(back) @ (high - low) / 2
    return _tilted_bounds(*_yawed_bounds(middle - half, middle + half, (yaw_rad[1] - yaw_rad[0]) / 2), tilt_rad)


def _tilted_bounds(low: Array, high: Array, tilt_rad: float) -> tuple[Array, Array]:
    """Of a vector turned by roll and pitch of up to `tilt_rad`, either one first."""
    reach, tilt = np.maximum(np.abs(low), np.abs(high)), np.sin(tilt_rad)
    more = tilt * (np.array([reach[2], reach[2], reach[0] + reach[1]]) + tilt * reach.sum())
    return low - more, high + more


def _yawed_bounds(low: Array, high: Array, yaw_rad: float) -> tuple[Array, Array]:
    """Of a vector turned about z by up to `yaw_rad` to either side."""
    reach = np.maximum(np.abs(low), np.abs(high))
    reach[2], flat = 0.0, np.array([*2 * [np.hypot(reach[0], reach[1])], np.inf])
    more = np.sin(min(yaw_rad, np.pi / 2)) * reach[[1, 0, 2]] + (1.0 - np.cos(min(yaw_rad, np.pi))) * reach
    return np.maximum(low - more, -flat), np.minimum(high + more, flat)


def _parts(v: Any) -> Vector:
    return v[..., 0], v[..., 1], v[..., 2]


def composite_inertia(robot: Robot, positions: dict[str, float]) -> Array:
    """(3, 3) about the centre of mass, in the body's axes, at joint positions by name (rad or m)."""
    total = -_point_mass(robot.total_mass_kg, centre_of_mass(robot, positions))
    for link, origin, rotation in _placed_links(robot, positions):
        total += _about_origin(link, origin, rotation)
    return total


def centre_of_mass(robot: Robot, positions: dict[str, float]) -> Array:
    """(3,) in the body frame, at joint positions by name (rad or m)."""
    moment = np.zeros(3)
    for link, origin, rotation in _placed_links(robot, positions):
        moment += link.mass_kg * (origin + rotation @ np.array(link.com_m))
    place: Array = moment / robot.total_mass_kg
    return place


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
    inertia: Array = mass_kg * (place @ place * np.eye(3) - np.outer(place, place))
    return inertia
