"""The way of a gripper from one grasp to the next: straight off it, across above (or around) everything, straight on.

Equation (14) is kept over the whole way as msgs/PLAN.md reads it between knots, not only at the knots: lifting and
lowering run along the gripped faces with the fingers open, and everything in between is a polyline of one height.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact, GripperShape, SwingLimits
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.hands import hands_of, rotations
from crux_planner.swing.swing_frame import SwingFrame

STEP_SHARE = 0.95  # of the distance a knot's duration allows: space for rounding
HEIGHT_RESERVE_M = 0.002
_SAMPLE_M = 0.01
_ROUNDING = 1e-9
_ROUNDS = 3  # of looking for a height at which grippers that leave or come aslant pass over all
_BODY_SIDE = 0.5  # way that a metre nearer to the body is worth
_CORNERS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])  # going round


@dataclass(frozen=True)
class Swing:
    """A way from one contact to another; `stations` are poses (5 or 7,), see model.hands, at the corners of the way.

    Station 0 is above the old grasp, the last one above the new grasp. `legs` are the least numbers of intervals
    between stations, `rise` and `fall` those of the vertical ways.
    """

    start: Contact
    end: Contact
    stations: Array
    legs: tuple[int, ...]
    rise: int
    fall: int

    @property
    def intervals(self) -> int:
        """Least number of knot intervals from the first knot in the air to touch-down."""
        return self.rise + sum(self.legs) + self.fall

    def poses(self, intervals: int) -> Array:
        """(intervals + 1, 5 or 7) poses at knots, from the old grasp (fingers closed on it) to the new one."""
        legs = list(self.legs)
        for _ in range(intervals - self.intervals):  # spare time goes to the leg with the longest steps
            steps = [np.linalg.norm(np.diff(self.stations[i : i + 2, :3], axis=0)) / n for i, n in enumerate(legs)]
            legs[int(np.argmax(steps))] += 1
        first, last = self.start.pose, self.end.pose
        swings = [_line(_open(self.start), self.stations[0], self.rise)]
        swings += [_line(self.stations[i], self.stations[i + 1], n) for i, n in enumerate(legs)]
        swings += [_line(self.stations[-1], _open(self.end), self.fall)]
        return np.vstack([first, *[way[1:] for way in swings[:-1]], swings[-1][1:-1], last])


def plan_swing(
    start: Contact,
    end: Contact,
    cuboids: Cuboids,
    shape: GripperShape,
    limits: SwingLimits,
    *,
    body_line_h_m: Array | None = None,
    skip: int = 0,
) -> Swing | None:
    """The best way found from `start` to `end`, or None where tall cuboids or the ways off the holds leave none.

    The best way is short and, where there is a choice, on the side of the body, whose path runs along `body_line_h_m`
    (2, 2): there the limb itself keeps off what its gripper goes around. `skip` leaves out the best ones.
    """
    frame, most_m = None, limits.max_height_m if limits.endless else np.inf
    given = start, end, cuboids
    if start.tilted or end.tilted:
        if (frame := SwingFrame.between(start, end)) is None:
            return None
        given = frame.contact(start), frame.contact(end), frame.cuboids(cuboids)
        limits = replace(limits, slabs=frame.cuboids(limits.slabs), floor_m=-np.inf)
        body_line_h_m = frame.plan_line(body_line_h_m)
    if not limits.endless:
        limits = limits.over(np.array([_foot_m(each, given[2]) for each in given[:2] if each.hold >= 0]))
    straight = _stations(*given[:2], [], max(contact.centre_h_m[2] for contact in given[:2]))
    if len(limits.slabs.yaw_rad) and _clear_height(*given[:2], straight, given[2], shape, limits, alone=True) is None:
        return None  # what is around holds does not help
    for corners in _candidate_ways(*given, shape, limits, body_line_h_m):
        way = _clear_way(corners, *given, shape, limits)
        if way is None:
            continue
        if frame is not None:
            way = frame.back(way, start, end)
            if way[:, 2].max() > most_m:
                continue
        if skip > 0:
            skip -= 1
            continue
        reach = STEP_SHARE * limits.speed_m_s * limits.dt_s
        turn = STEP_SHARE * limits.yaw_rate_rad_s * limits.dt_s
        steps = np.abs(np.diff(way, axis=0))
        legs = [max(1, int(np.ceil(np.linalg.norm(s[:3]) / reach)), int(np.ceil(_turned_rad(s) / turn))) for s in steps]
        rise, fall = (
            max(1, int(np.ceil(np.linalg.norm(above[:3] - contact.centre_h_m) / reach)))
            for above, contact in ((way[0], start), (way[-1], end))
        )
        return Swing(start, end, way, tuple(legs), rise, fall)
    return None


def _clear_way(
    corners: list[Array], start: Contact, end: Contact, cuboids: Cuboids, shape: GripperShape, limits: SwingLimits
) -> Array | None:
    """Stations at a height from which the polyline passes over all it must pass over; None where there is none. Where
    grippers leave and come aslant, the higher they are, the farther off their holds.
    """
    height = max(start.centre_h_m[2], end.centre_h_m[2])
    for _ in range(_ROUNDS if start.tilted or end.tilted else 1):
        clear = _clear_height(start, end, _stations(start, end, corners, height), cuboids, shape, limits)
        if clear is None:
            return None
        height = max(height, clear)
    return _stations(start, end, corners, height)


def least_intervals(contacts: list[Contact], limits: SwingLimits) -> Array:
    """(C, C) knot intervals that swings from one contact to another take at least: straight, up and down."""
    places, yaw = np.array([c.centre_h_m for c in contacts]), np.array([c.yaw_rad for c in contacts])
    away, turn = np.linalg.norm(places[:, None] - places, axis=2), np.abs(yaw[:, None] - yaw)
    across = np.maximum(away / limits.speed_m_s, turn / limits.yaw_rate_rad_s) / (STEP_SHARE * limits.dt_s)
    return np.asarray(2.0 + np.maximum(np.ceil(across - _ROUNDING), 1.0))


def column_gap(points: Array, cuboids: Cuboids) -> Array:
    """Least plan-view distance (V,) of points (..., 3) to each cuboid."""
    count = len(cuboids.yaw_rad)
    return np.asarray(cuboids.plan_distance(points).reshape(-1, count).min(axis=0)) if count else np.zeros(0)


def footprint(pose: Array, half_length: Array | float) -> Array:
    """Points (..., 9, 3) along the opening axis of grippers at poses or hands (..., n); half lengths (...) or one for
    all.
    """
    along = np.linspace(-1.0, 1.0, 9) * np.asarray(half_length)[..., None]
    axis = rotations(hands_of(pose))[..., 0]
    return np.asarray(pose[..., None, :3] + along[..., None] * axis[..., None, :])


def palms(pose: Array, finger_height_m: float) -> Array:
    """Poses (..., n) moved from the pads to the palm: seen from above, those of grippers aslant are beside them."""
    moved = pose.copy()
    moved[..., :3] += finger_height_m * rotations(hands_of(pose))[..., 2]
    return moved


def gripper_gap(a: Array, b: Array) -> float:
    """Least plan-view distance between the centre lines of gripper footprints (..., 9, 3)."""
    first, second = a.reshape(-1, 3)[:, :2], b.reshape(-1, 3)[:, :2]
    return float(np.linalg.norm(first[:, None] - second[None], axis=-1).min())


def palm_gap(a: Array, b: Array, half_width: float) -> float:
    """Least plan-view distance of palms (x, y, yaw, half length), (n, 4) and (m, 4): rectangles that do not cross."""

    def apart(corners_of: Array, boxes: Array) -> float:
        x, y, yaw, length = (corners_of[:, None, i] for i in range(4))
        along, across = length * np.array([1, 1, -1, -1]), half_width * np.array([1, -1, 1, -1])
        c, s = np.cos(yaw), np.sin(yaw)
        points = np.stack([x + along * c - across * s, y + along * s + across * c], axis=-1)
        way = points[:, :, None] - boxes[:, :2]  # (n, 4, m, 2)
        c, s = np.cos(boxes[:, 2]), np.sin(boxes[:, 2])
        beyond = np.abs(np.stack([c * way[..., 0] + s * way[..., 1], c * way[..., 1] - s * way[..., 0]], axis=-1))
        beyond = np.maximum(beyond - np.stack([boxes[:, 3], np.full(len(boxes), half_width)], axis=-1), 0.0)
        return float(np.linalg.norm(beyond, axis=-1).min())

    return min(apart(a, b), apart(b, a))


def _clear_height(
    start: Contact,
    end: Contact,
    way: Array,
    cuboids: Cuboids,
    shape: GripperShape,
    limits: SwingLimits,
    *,
    alone: bool = False,
) -> float | None:
    """Height at which the polyline passes over all it must pass over; None where something is too tall for that.
    `alone`: as if there were no cuboids but the two that are gripped.
    """
    samples = _dense(way)
    fingers = footprint(samples, samples[:, 4] + shape.pad_radius)[:, [0, -1]]
    length = shape.half_length(samples[:, 4])
    columns, finger_m, palm_m, floor_m = footprint(samples, length), 0.0, shape.finger_height, limits.floor_m
    if start.tilted or end.tilted:
        columns = np.concatenate([columns, footprint(palms(samples, shape.finger_height), length)])
        along, across, up = np.moveaxis(rotations(hands_of(samples))[:, 2], -1, 0)
        finger_m = float((np.abs(along) * (samples[:, 4] + 2 * shape.pad_radius)).max())
        lowest = shape.finger_height * up - length * np.abs(along) - shape.pad_radius * np.abs(across)
        palm_m = float(lowest.min())
    own_top = np.array([_top_m(contact, cuboids) for contact in (start, end) if contact.hold >= 0])
    overhead_m, slabs = limits.overhead_m(shape), limits.slabs
    if alone:
        cuboids = cuboids.some(np.isin(np.arange(len(cuboids.yaw_rad)), [start.hold, end.hold]))
    cuboids = cuboids.near(columns, limits.clearance_m)
    cuboids, slabs = (each.some(each.bottom_m < overhead_m) for each in (cuboids, slabs))
    under = column_gap(fingers, cuboids) < limits.clearance_m
    beside = column_gap(columns, cuboids) < shape.pad_radius + limits.body_clearance_m
    top = cuboids.top_m
    height = max(float(own_top.max(initial=floor_m)), top[under].max(initial=floor_m)) + limits.clearance_m + finger_m
    # What the palm passes over, or stands beside, must be lower than the palm.
    height = max(height, (top[beside] + limits.body_clearance_m - palm_m).max(initial=floor_m))
    if len(slabs.yaw_rad):
        height = max(height, slabs.top_near(fingers, limits.clearance_m) + limits.clearance_m + finger_m)
        beside_m = shape.pad_radius + limits.body_clearance_m
        height = max(height, slabs.top_near(columns, beside_m) + limits.body_clearance_m - palm_m)
    return float(height + HEIGHT_RESERVE_M) if height + HEIGHT_RESERVE_M <= limits.max_height_m else None


def _foot_m(contact: Contact, cuboids: Cuboids) -> float:
    """Height of the middle of a hold's foot, or of a foothold."""
    return float(contact.place_h_m[2] if contact.foot else cuboids.foot_m[contact.hold, 2])


def _top_m(contact: Contact, cuboids: Cuboids) -> float:
    """Height of the top of a hold, or of a foothold."""
    return float(contact.place_h_m[2] if contact.foot else cuboids.top_m[contact.hold])


def _candidate_ways(
    start: Contact, end: Contact, cuboids: Cuboids, shape: GripperShape, limits: SwingLimits, body_line: Array | None
) -> list[list[Array]]:
    """The straight way, and ways around each cuboid that it meets and cannot pass over, best first."""
    a, b = start.centre_h_m[:2], end.centre_h_m[:2]
    swings: list[list[Array]] = [[]]
    tall = cuboids.top_m + limits.clearance_m + HEIGHT_RESERVE_M > limits.max_height_m
    tall &= cuboids.bottom_m < limits.overhead_m(shape)
    line = a + np.linspace(0, 1, 21)[:, None] * (b - a)
    length, width = float(shape.half_length(max(start.open_m, end.open_m))), shape.pad_radius
    for v in np.flatnonzero(tall):
        if cuboids.plan_distance(line)[:, v].min() > length + limits.body_clearance_m:
            continue
        c, s = np.cos(cuboids.yaw_rad[v]), np.sin(cuboids.yaw_rad[v])
        turns = np.array([start.yaw_rad, end.yaw_rad]) - cuboids.yaw_rad[v]
        cosine, sine = np.abs(np.cos(turns)), np.abs(np.sin(turns))
        along, across = (length * cosine + width * sine).max(), (length * sine + width * cosine).max()
        slack = limits.clearance_m + np.array([along, across])
        to_h = np.array([[c, -s], [s, c]])
        middle, half = (each[v] for each in cuboids.outline)
        corners = [middle + to_h @ ((half + slack) * sign) for sign in _CORNERS]
        for i in range(4):  # past one corner, or along one side
            swings += [[corners[i]], [corners[i], corners[i - 1]], [corners[i - 1], corners[i]]]

    def badness(corners: list[Array]) -> float:
        aside = 0.0 if body_line is None or not corners else max(_beside(corner, body_line) for corner in corners)
        legs = np.diff(np.array([a, *corners, b]), axis=0)
        return float(np.linalg.norm(legs, axis=1).sum()) + _BODY_SIDE * aside

    return sorted(swings, key=badness)


def _stations(start: Contact, end: Contact, corners: list[Array], height_m: float) -> Array:
    """Stations (k, 5 or 7) at a height: off the old grasp the way it is left, at the corners, off the new grasp."""
    plan = np.array([_off(start, height_m), *corners, _off(end, height_m)])
    lengths = np.linalg.norm(np.diff(plan, axis=0), axis=1)
    share = np.concatenate([[0.0], np.cumsum(lengths)]) / max(lengths.sum(), 1e-9)
    share[-1] = 1.0
    yaw = start.yaw_rad + share * (end.yaw_rad - start.yaw_rad)
    opening = start.open_m + share * (end.open_m - start.open_m)
    stations = np.column_stack([plan, np.full(len(plan), height_m), yaw, opening])
    if start.tilt_rad is None or end.tilt_rad is None:
        return stations
    return np.hstack([stations, start.tilt_rad + share[:, None] * (end.tilt_rad - start.tilt_rad)])


def _off(contact: Contact, height_m: float) -> Array:
    """(2,) where a gripper is, seen from above, that has left its hold straight up to a height."""
    if not contact.tilted:
        return contact.centre_h_m[:2]
    up = contact.up
    return np.asarray(contact.centre_h_m[:2] + (height_m - contact.centre_h_m[2]) / up[2] * up[:2])


def _turned_rad(step: Array) -> float:
    """The most that a gripper turns over the difference (5 or 7,) of two poses."""
    return float(abs(step[3]) + np.linalg.norm(step[5:]))


def _dense(way: Array) -> Array:
    """The polyline sampled every centimetre (and every twentieth of a radian)."""
    pieces = []
    for a, b in itertools.pairwise(way):
        n = int(np.ceil(max(float(np.linalg.norm(b[:3] - a[:3])) / _SAMPLE_M, _turned_rad(b - a) / 0.05, 1.0)))
        pieces.append(_line(a, b, n))
    return np.vstack(pieces)


def _open(contact: Contact) -> Array:
    pose = contact.pose
    pose[4] = contact.open_m
    return pose


def _line(a: Array, b: Array, intervals: int) -> Array:
    return a + np.linspace(0.0, 1.0, intervals + 1)[:, None] * (b - a)


def _beside(point: Array, line: Array) -> float:
    """Distance of a point (2,) from a segment (2, 2)."""
    along = line[1] - line[0]
    share = np.clip((point - line[0]) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return float(np.linalg.norm(point - line[0] - share * along))
