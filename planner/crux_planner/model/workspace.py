"""Where, in the body frame, a gripper may be (9a), computed from the limb's kinematics: inner sets and an outer one.

A gripper stands upright on the wall (its z along W's z) while the body tilts and the gripper turns about W's z. A grid
of positions is kept where inverse kinematics exists, with a margin to every joint limit, for every corner of the range
of tilt and yaw. The tilt is what start and goal need: the further a body may tilt, the less its limbs reach at all
tilts. The acceptance box holds every height a gripper needs to grasp and to lift over the faces it held; in plan view
it is the largest rectangle inside that set, and it then grows upwards as far as it fits. The inner polytope has the
same heights and in plan view contains that rectangle and as much of the set as a convex polygon with edges in six
directions can. Plans keep to one of these two. The outer polytope contains every place of the wrist above a gripper
that grips, whatever its yaw and the body's tilt, up to the joint limits themselves: proofs and bounds are about it. The
wrist is at about the body's own height, so a tilt hardly moves it along the wall.

The inner sets are one for all body heights, pad heights and gripper yaws of the robot's ranges, and for all tilts up to
that of start and goal: there are no bins of these. Yaw is looked at in the middle and at both ends of its range, tilt
at its corners, places every 10 mm; the margin to the joints' limits covers what is between. What that leaves out, of a
limb of `scaler` in plan view: in 1824 cm2 a level body at 0.185 m can grip at yaw 0 and lift by 0.1 m; 1659 hold for
all heights, a tilt of 3.4 degrees and yaws within 20 degrees, 1045 for all yaws; 721 are in the convex polytope, 450
in the box.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.errors import InfeasibleError
from crux_planner.model import chain, kept, kinematics
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import inverse, joint_margin, limit_margin, rotation_from_rpy, rotation_z

GRID_M = 0.01
JOINT_MARGIN_RAD = 0.05  # covers the grid between its points, IK of a tracked (not exact) pose, and encoder offsets
STRETCHED_M = 0.004  # kept of the polytope's edges: near a stretched limb so little is all of a joint's margin
_SMALLEST_HALF_M = 0.02  # a box smaller than this is no workspace
_FINE_RAD = 0.005  # between joint angles that the outer set is computed from
_ANGLES_DEG = (30.0, 60.0, 120.0, 150.0)  # of polytopes' edges beyond those of boxes
CHAIN_GRID_M = 0.02  # the same of limbs without a closed form
_SHARES = ((1.0, 1.0), (1.0, 0.25), (1.0, 0.0), (0.0, 0.25), (0.0, 0.0))  # of heights and yaws, for `part`
_YAWS = 7  # that are compared
_DIRECTIONS = np.vstack([np.eye(3), *[[[np.cos(a), np.sin(a), 0.0]] for a in np.radians(_ANGLES_DEG)]])
_PLAN = _DIRECTIONS[[0, 1, *range(3, len(_DIRECTIONS))], :2]  # of these, those in plan view
_KINDS = ("box", "inner", "outer")  # in the file that keeps them, with
_PARTS = ("directions", "middle_m", "extent_m", "max_tilt_rad", "above_m")
_CORNER_ROUNDS = 100  # at most, of cutting corners off the inner polytope that are out of reach
LEVEL_RAD = 0.06  # how far a body tilts on its way between poses that are level
_TILT_STEP_RAD = 0.02  # between the tilts that sets are computed for


@dataclass(frozen=True)
class WorkspaceRange:
    """What the box must hold for: the ranges of body and gripper the planner may use."""

    body_height_m: tuple[float, float]
    pad_height_m: tuple[float, float]  # of a grasp above the wall
    lift_height_m: float  # a gripper must get so high above the wall, however low the body
    max_swing_height_m: float
    max_tilt_rad: float
    gripper_yaw_rad: tuple[float, float]  # relative to the body
    widest_tilt_rad: float  # that a body may have at all, for the outer set

    def part(self, yaw_rad: float, turns: float, heights: float) -> WorkspaceRange:
        """Of it a share of the yaws to either side of one, and of the body's heights around their middle."""
        (low, high), (least, most) = self.body_height_m, self.gripper_yaw_rad
        middle, up, turn = (low + high) / 2, heights * (high - low) / 2, turns * (most - least)
        yaws = max(least, yaw_rad - turn), min(most, yaw_rad + turn)
        return replace(self, body_height_m=(middle - up, middle + up), gripper_yaw_rad=yaws)


@dataclass(frozen=True)
class Reach:
    """|D R(theta)^T (c_l + above - r) - middle_l| <= extent_l of (9a), limbs LF, RF, LR, RR.

    D are unit vectors, of which the first three are x, y and z: with these alone it is a box. It is about a point that
    is `above_m` from the gripper along W's z.
    """

    directions: Array  # D (m, 3)
    middle_m: Array  # (4, m)
    extent_m: Array  # (4, m)
    max_tilt_rad: float  # roll and pitch of the body for which this holds
    above_m: float = 0.0

    @property
    def centre_b_m(self) -> Array:
        """(4, 3) of the box around it."""
        return self.middle_m[:, :3]

    @property
    def half_m(self) -> Array:
        """(3,) of that box."""
        return np.asarray(self.extent_m[:, :3].max(axis=0))

    def less(self, aside_m: float) -> Reach:
        """The part in which a gripper stays when it moves by as much along both x and y, of H or any turned about z."""
        along_wall = np.hypot(self.directions[:, 0], self.directions[:, 1])
        return replace(self, extent_m=self.extent_m - 2**0.5 * aside_m * along_wall)

    def beyond(self, limb: int, place_b_m: Array) -> Array:
        """(..., m) how far places (..., 3) in the body frame are outside, direction by direction."""
        return np.asarray(np.abs(place_b_m @ self.directions.T - self.middle_m[limb]) - self.extent_m[limb])


def box(centre_b_m: Array, half_m: Array, max_tilt_rad: float) -> Reach:
    """A box a limb, (4, 3) and (3,)."""
    return Reach(np.eye(3), centre_b_m, np.tile(half_m, (len(centre_b_m), 1)), max_tilt_rad)


@dataclass(frozen=True)
class LimbReach:
    """What the limbs of one robot reach: the acceptance box, the inner and the outer polytope."""

    box: Reach
    inner: Reach
    outer: Reach
    grip_height_m: tuple[float, float]  # of grippers that grip, above the body's origin along W's z


def limb_reach(limbs: Sequence[Limb], wanted: WorkspaceRange) -> LimbReach:
    """Of all limbs; what was computed before is read from ~/.cache/crux/reach.

    Raises InfeasibleError where the limbs leave no acceptance box for the asked range of heights, tilt and yaw.
    """
    shape = [[v for k, v in sorted(vars(limb).items()) if k != "joints"] for limb in limbs]
    limits = [[limb.lower_rad, limb.upper_rad] for limb in limbs]
    height, pads = wanted.body_height_m, wanted.pad_height_m
    grip_height_m = pads[0] - height[1], pads[1] - height[0]

    def compute() -> dict[str, Array]:
        if limbs[0].closed_form:
            boxes, ranges = acceptance_boxes(limbs, wanted), [wanted]
        else:
            boxes, ranges = _own_boxes(limbs, wanted)
        reaches = boxes, _inner(limbs, ranges, boxes), _outer(limbs, wanted, grip_height_m)
        kinds = zip(_KINDS, reaches, strict=True)
        return {f"{kind}_{part}": getattr(reach, part) for kind, reach in kinds for part in _PARTS}

    known = kept.arrays((__file__, kinematics.__file__, chain.__file__), (shape, limits, wanted), compute)
    boxes, inner, outer = (Reach(*(known[f"{kind}_{part}"] for part in _PARTS)) for kind in _KINDS)
    return LimbReach(boxes, inner, outer, grip_height_m)


def tilt_for(poses_rpy_rad: Sequence[Array], widest_rad: float) -> float:
    """The tilt [rad] that sets must hold for where the body has these poses (3,) of roll, pitch and yaw."""
    needed = float(np.abs([rpy[:2] for rpy in poses_rpy_rad]).max())
    steps = float(np.ceil(needed / _TILT_STEP_RAD - 1e-6))
    return min(max(LEVEL_RAD, _TILT_STEP_RAD * steps), widest_rad)


def leaning_m(limb: Limb, tilt_rad: float) -> float:
    """How much higher or lower a body tilted beyond LEVEL_RAD has grippers half a limb's length off their shoulders."""
    lever = float(np.abs(limb.shoulder_b_m[:2]).max()) + (limb.upper_link_m + limb.lower_link_m) / 2
    return float(lever * max(tilt_rad - LEVEL_RAD, 0.0))


def acceptance_boxes(limbs: Sequence[Limb], wanted: WorkspaceRange) -> Reach:
    """The acceptance boxes of all limbs, all of one size and height: of mirror images, those of the first."""
    if limbs[0].closed_form:
        low, high = _largest_box(limbs[0], wanted)
        return box((low + high) / 2 * _mirror(limbs), (high - low) / 2, wanted.max_tilt_rad)
    return _own_boxes(limbs, wanted)[0]


def _own_boxes(limbs: Sequence[Limb], wanted: WorkspaceRange) -> tuple[Reach, list[WorkspaceRange]]:
    """Boxes of limbs that are no mirror images, and what each holds for: as much of the yaws, around those at which the
    limb reaches most, and of the body's heights as leaves all limbs one. Raises InfeasibleError.
    """
    yaws = [_best_yaw(limb, wanted) for limb in limbs]
    for heights, turns in _SHARES:
        ranges = [wanted.part(yaw, turns, heights) for yaw in yaws]
        try:
            corners = np.array([_largest_box(limb, own) for limb, own in zip(limbs, ranges, strict=True)])
        except InfeasibleError:
            if (heights, turns) == _SHARES[-1]:
                raise
            continue
        break
    corners[:, 1, 2] = corners[:, 1, 2].min()
    centre, half = corners.mean(axis=1), (corners[:, 1] - corners[:, 0]).min(axis=0) / 2
    return box(centre, half, wanted.max_tilt_rad), ranges


def _best_yaw(limb: Limb, wanted: WorkspaceRange) -> float:
    """At which a limb reaches most with the body level and in the middle of its heights; of equals the nearest to 0."""
    span = limb.upper_link_m + limb.lower_link_m
    x, y = (limb.shoulder_b_m[axis] + np.arange(-span, span, 2 * CHAIN_GRID_M) for axis in (0, 1))
    height = (sum(wanted.pad_height_m) - sum(wanted.body_height_m)) / 2
    places = np.stack(np.meshgrid(x, y, height, indexing="ij"), axis=-1)
    level = replace(wanted, max_tilt_rad=0.0)
    low, high = wanted.gripper_yaw_rad
    yaws: list[float] = sorted(np.linspace(low, high, _YAWS).tolist(), key=abs)
    return max(yaws, key=lambda yaw: int(reachable(limb, places, replace(level, gripper_yaw_rad=(yaw, yaw))).sum()))


def _mirror(limbs: Sequence[Limb]) -> Array:
    """(4, 3) signs of x, y, z that take the first limb's places to each limb's."""
    signs = np.array([np.sign(limb.shoulder_b_m[:2]) for limb in limbs])
    return np.concatenate([signs * signs[0], np.ones((len(limbs), 1))], axis=1)


def _grid_m(limb: Limb) -> float:
    return GRID_M if limb.closed_form else CHAIN_GRID_M


def _inner(limbs: Sequence[Limb], ranges: Sequence[WorkspaceRange], boxes: Reach) -> Reach:
    """A convex set of what the limbs reach over all the box's heights, around the box; limbs that are mirror images
    have one range.
    """
    if limbs[0].closed_form:
        vertices, z = _inner_polygon(limbs[0], boxes.centre_b_m[0], boxes.half_m, ranges[0])
        each = [vertices * mirror[:2] for mirror in _mirror(limbs)]
    else:
        own = zip(limbs, boxes.centre_b_m, ranges, strict=True)
        polygons = [_inner_polygon(limb, centre, boxes.half_m, wanted) for limb, centre, wanted in own]
        each, z = [vertices for vertices, _ in polygons], polygons[0][1]
    along = [vertices @ _PLAN.T for vertices in each]
    lows = np.insert(np.array([a.min(axis=0) for a in along]), 2, z[0], axis=1)
    highs = np.insert(np.array([a.max(axis=0) for a in along]), 2, z[-1], axis=1)
    return Reach(_DIRECTIONS, (lows + highs) / 2, (highs - lows) / 2, boxes.max_tilt_rad)


def _inner_polygon(limb: Limb, centre: Array, half: Array, wanted: WorkspaceRange) -> tuple[Array, Array]:
    """Corners (v, 2) in plan view, and the heights looked at."""
    side, grid = np.sign(limb.shoulder_b_m[1]), _grid_m(limb)
    span = limb.upper_link_m + limb.lower_link_m + grid
    x = limb.shoulder_b_m[0] + np.arange(-span, span, grid)
    y = side * np.arange(grid / 2, abs(limb.shoulder_b_m[1]) + span, grid)
    z = np.linspace(centre[2] - half[2], centre[2] + half[2], int(np.ceil(2 * half[2] / grid)) + 1)
    ok = reachable(limb, np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1), wanted).all(axis=2).ravel()
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    corners = centre[:2] + half[:2] * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    normals = np.vstack([_PLAN, -_PLAN])
    most = np.zeros(0)
    for _ in range(_CORNER_ROUNDS):
        before, most = most, _polygon(points, ok, normals, corners)
        most = np.maximum(most - STRETCHED_M, (corners @ normals.T).max(axis=0))
        vertices = _vertices(normals, most)
        columns = np.column_stack([np.repeat(vertices, len(z), axis=0), np.tile(z, len(vertices))])
        beyond = vertices[~reachable(limb, columns, wanted).reshape(-1, len(z)).all(axis=1)]
        if len(beyond) == 0 or np.array_equal(most, before):  # none, or only where the box has them
            break
        points, ok = np.vstack([points, beyond]), np.append(ok, np.zeros(len(beyond), dtype=bool))
    return vertices, z


def _polygon(points: Array, ok: Flags, normals: Array, within: Array) -> Array:
    """How far (k,) a polygon with edges along `normals` (k, 2) may go that has no point (n, 2) but those that are `ok`.

    One by one the edge moves that gives up the fewest points for the bad point that costs most; it goes around
    `within`, and bad points in there stay.
    """
    along = points @ normals.T
    least = (within @ normals.T).max(axis=0) - 1e-9
    most = along[ok].max(axis=0)
    while True:
        inside = (along <= most + 1e-9).all(axis=1)
        bad, good = along[inside & ~ok], np.sort(along[inside & ok], axis=0)
        left = np.stack([np.searchsorted(g, b - 1e-9) for g, b in zip(good.T, bad.T, strict=True)], axis=1)
        bound = np.take_along_axis(good, np.maximum(left - 1, 0), axis=0)
        lost = np.where((left > 0) & (bound >= least), len(good) - left, len(good) + 1)
        lost[lost.min(axis=1) > len(good)] = -1  # `within` has them, so no edge may leave them out
        if not (lost >= 0).any():
            return np.asarray(most)
        worst = int(np.argmax(lost.min(axis=1)))
        edge = int(np.argmin(lost[worst]))
        most[edge] = bound[worst, edge]


def _vertices(normals: Array, most: Array) -> Array:
    """Corners (v, 2) of the polygon normals @ p <= most."""
    a, b = np.triu_indices(len(normals), k=1)
    pairs = np.stack([normals[a], normals[b]], axis=1)
    crossing = np.abs(np.linalg.det(pairs)) > 1e-9
    corners = np.linalg.solve(pairs[crossing], np.stack([most[a], most[b]], axis=1)[crossing][..., None])[..., 0]
    return np.asarray(corners[(corners @ normals.T <= most + 1e-9).all(axis=1)])


def _outer(limbs: Sequence[Limb], wanted: WorkspaceRange, grip_height_m: tuple[float, float]) -> Reach:
    """All places of wrists of grippers that grip: any yaw, the body's tilts, all but the wrist's joints in limits."""
    tilt, lows, highs = wanted.widest_tilt_rad, [], []
    if not limbs[0].closed_form:  # no farther from the first joint than the limb is long
        middle = np.array([limb.shoulder_b_m for limb in limbs]) @ _DIRECTIONS.T
        longest = np.array([limb.longest_m for limb in limbs])
        return Reach(_DIRECTIONS, middle, np.tile(longest[:, None], len(_DIRECTIONS)), tilt)
    above = {limb.wrist_to_gripper_m for limb in limbs}.pop()
    for limb in limbs:
        l1, l2 = limb.upper_link_m, limb.lower_link_m
        ranges = zip(limb.lower_rad[1:3], limb.upper_rad[1:3], strict=True)
        q2, q3 = (np.append(np.arange(low, high, _FINE_RAD), high) for low, high in ranges)
        rounding = _FINE_RAD / 2 * (l1 + 2 * l2)
        radius = (l1 * np.cos(q2)[:, None] + l2 * np.cos(q2[:, None] - q3)).ravel()
        height = limb.shoulder_b_m[2] + (l1 * np.sin(q2)[:, None] + l2 * np.sin(q2[:, None] - q3)).ravel()
        # its height along W's z is u_z cos(roll) cos(pitch) and no more than `aside` of what is along x and y
        aside = np.sin(tilt) * (np.abs(limb.shoulder_b_m[:2]).sum() + 2**0.5 * (np.abs(radius) + rounding))
        least, most = grip_height_m[0] + above - aside, grip_height_m[1] + above + aside
        steep = np.cos(tilt) ** 2
        grips = height + rounding >= np.minimum(least, least / steep)
        grips &= height - rounding <= np.maximum(most, most / steep)
        inward, outward = radius[grips].min() - rounding, radius[grips].max() + rounding
        azimuth = limb.mount_rad + np.array([limb.lower_rad[0], limb.upper_rad[0]])
        ways = np.arctan2(_DIRECTIONS[:, 1], _DIRECTIONS[:, 0])
        ends = []
        for way in (ways, ways + np.pi):
            most, least = _largest_cos(azimuth - way[:, None]), -_largest_cos(azimuth - way[:, None] + np.pi)
            flat = np.max([r * c for r in (inward, outward) for c in (most, least)], axis=0)
            ends.append(flat + np.column_stack([np.cos(way), np.sin(way)]) @ limb.shoulder_b_m[:2])
        high, low = ends[0], -ends[1]
        low[2], high[2] = height[grips].min() - rounding, height[grips].max() + rounding
        lows.append(low)
        highs.append(high)
    return Reach(_DIRECTIONS, (np.array(lows) + highs) / 2, (np.array(highs) - lows) / 2, tilt, above)


def _largest_cos(angles: Array) -> Array:
    """(n,) the largest cosine between the two angles of each pair (n, 2)."""
    whole = np.ceil(angles[:, 0] / (2 * np.pi)) * 2 * np.pi <= angles[:, 1]
    return np.where(whole, 1.0, np.cos(angles).max(axis=1))


def reachable(limb: Limb, position_b_m: Array, wanted: WorkspaceRange) -> Flags:
    """Whether the gripper reaches positions (..., 3) for every corner of tilt and yaw, with margin to the limits."""
    if not limb.closed_form:
        return _reachable_by_chain(limb, position_b_m, wanted)
    ok = np.ones(position_b_m.shape[:-1], dtype=bool)
    low, high = wanted.gripper_yaw_rad
    for roll in (-wanted.max_tilt_rad, wanted.max_tilt_rad):
        for pitch in (-wanted.max_tilt_rad, wanted.max_tilt_rad):
            untilt = rotation_from_rpy(np.array([roll, pitch, 0.0])).T
            for yaw in (low, (low + high) / 2, high):
                rotation = np.broadcast_to(untilt @ rotation_z(yaw), (*ok.shape, 3, 3))
                q, reached = inverse(limb, position_b_m, rotation)
                ok &= reached & (limit_margin(limb, q) >= JOINT_MARGIN_RAD)
    return ok


def _reachable_by_chain(limb: Limb, position_b_m: Array, wanted: WorkspaceRange) -> Flags:
    """The same, corner by corner of the places still in reach, as if a limb could turn its gripper in all ways."""
    low, high, tilt = *wanted.gripper_yaw_rad, wanted.max_tilt_rad
    shape, places = position_b_m.shape[:-1], position_b_m.reshape(-1, 3)
    left = np.arange(len(places))
    for yaw, roll, pitch in itertools.product((low, high, (low + high) / 2), (-tilt, tilt), (-tilt, tilt)):
        rotation = rotation_from_rpy(np.array([roll, pitch, 0.0])).T @ rotation_z(yaw)
        q, reached = inverse(limb, places[left], rotation)
        left = left[reached & (joint_margin(limb, q) >= JOINT_MARGIN_RAD)]
    ok = np.zeros(len(places), dtype=bool)
    ok[left] = True
    return ok.reshape(shape)


def _largest_box(limb: Limb, wanted: WorkspaceRange) -> tuple[Array, Array]:
    """Lower and upper corner of the largest box in the limb's own quadrant that holds every grasp height."""
    quadrant = np.sign(limb.shoulder_b_m[:2])
    span = limb.upper_link_m + limb.lower_link_m
    grid = _grid_m(limb)
    # Kept half a grid step off the body's middle planes, so that boxes of two limbs never overlap.
    x = np.arange(grid / 2, abs(limb.shoulder_b_m[0]) + span, grid)
    y = np.arange(grid / 2, abs(limb.shoulder_b_m[1]) + span, grid)
    lean = leaning_m(limb, wanted.max_tilt_rad)
    bottom = wanted.pad_height_m[0] - wanted.body_height_m[1] - lean
    top = wanted.max_swing_height_m - wanted.body_height_m[0] + lean
    z = np.linspace(bottom, top, int(np.ceil((top - bottom) / grid)) + 1)
    inside_up_to = np.logical_and.accumulate(
        reachable(limb, np.stack(np.meshgrid(x * quadrant[0], y * quadrant[1], z, indexing="ij"), axis=-1), wanted),
        axis=2,
    )
    level = int(np.searchsorted(z, wanted.lift_height_m - wanted.body_height_m[0] + lean - 1e-9))
    area, (i0, i1, j0, j1) = largest_rectangle(inside_up_to[:, :, level])
    if area == 0:
        tilt = f"tilts of the body up to {np.degrees(wanted.max_tilt_rad):.1f} degrees"
        text = f"no acceptance box: the limb cannot grasp and lift at all heights of the body and {tilt}"
        raise InfeasibleError("reach", text)
    while level + 1 < len(z) and inside_up_to[i0 : i1 + 1, j0 : j1 + 1, level + 1].all():
        level += 1
    inner, outer = np.array([x[i0], y[j0]]) * quadrant, np.array([x[i1], y[j1]]) * quadrant
    low, high = np.append(np.minimum(inner, outer), z[0]), np.append(np.maximum(inner, outer), z[level])
    if ((high - low) / 2 < _SMALLEST_HALF_M).any():
        raise InfeasibleError("reach", f"the limb's acceptance box would be only {high - low} m large")
    return low, high


def largest_rectangle(mask: Flags) -> tuple[float, tuple[int, int, int, int]]:
    """Largest axis-aligned rectangle of true cells, between cell centres: area in cells and (i0, i1, j0, j1)."""
    n, m = mask.shape
    counts = np.vstack([np.zeros((1, m), dtype=int), np.cumsum(mask, axis=0)])
    first, last = np.triu_indices(n, k=1)
    full = counts[last + 1] - counts[first] == (last - first + 1)[:, None]  # column all true between rows first..last
    run = np.zeros(len(first), dtype=int)
    best_run, best_end = np.zeros_like(run), np.zeros_like(run)
    for j in range(m):
        run = np.where(full[:, j], run + 1, 0)
        longer = run > best_run
        best_run, best_end = np.where(longer, run, best_run), np.where(longer, j, best_end)
    area = (last - first) * np.maximum(best_run - 1, 0)
    i = int(np.argmax(area))
    end = int(best_end[i])
    return float(area[i]), (int(first[i]), int(last[i]), end - int(best_run[i]) + 1, end)
