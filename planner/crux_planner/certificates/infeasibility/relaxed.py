"""What every plan satisfies, whatever its headings, tilts, off-centre grasps and swings: an optimistic P1.

Reach: (9a) of the wrists, heading by heading. A small tilt moves all of them by the same way against the boxes, as if
the body were elsewhere: the boxes bound that place, the sole. Balance: the whole limit surface (2)+(3), from
outside by tangents; grasps anywhere on their faces; what accelerations within the bounds (7) may add. No swings, no
collisions, no torques.
"""

from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.contacts import Grip
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.mass import gripper_spans, in_heading, offset_bounds
from crux_planner.model.problem import Problem
from crux_planner.physics.dynamics import static_map
from crux_planner.physics.limit_surface import grip_rows, polytope_directions
from crux_planner.search.equilibrium import FORCE_BOUND_N, MOMENT_ARM_M, TWIST_BOUND_NM, StaticEquilibrium
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import block_diagonal, skews

BIN_RAD, GOAL_BIN_RAD = 0.02, 0.008
TOLERANCE_M = 1e-3  # more than the check forgives, and than the solvers' rounding
_ROUNDS, _CUT_N = 8, 0.1  # of adding tangents of the limit surface, where wrenches are so far beyond it
_INERTIA_SHARE = 3.0  # the inertia at any posture against that at the start


@dataclass(frozen=True)
class Headings:
    """Bins of the body's yaw, and in each the bounds (B, 4, G, 2) of the sole with a limb's grip in reach.

    With q = Rz(yaw)^T (c - r), c the wrists, (9a) bounds Rx(roll)^T Ry(pitch)^T q, which is
    q + (sin(pitch), -sin(roll) cos(pitch)) h but for terms of second order and the heights' difference, h being the
    body's height above the middle one of theirs.
    The sole is r less that shift, along the axes of the bin's middle.
    """

    yaw_rad: Array  # (B,) middles
    to_h: Array  # (B, 3, 3)
    low: Array
    high: Array

    def fits(self, stance: tuple[int, ...]) -> tuple[Flags, Array, Array]:
        """Bins (B,) in which a sole has a stance's grips in reach (-1: air), and its bounds (B, 2)."""
        limbs = [limb for limb, g in enumerate(stance) if g >= 0]
        grips = [stance[limb] for limb in limbs]
        low, high = self.low[:, limbs, grips].max(axis=1), self.high[:, limbs, grips].min(axis=1)
        return (low <= high).all(axis=1), low, high


def _goal_angle(problem: Problem) -> float:
    """Most [rad] that roll, pitch and yaw differ from the goal's by the one turn of its tolerance."""
    turn = problem.goal.tolerance_rad
    return float(turn / np.cos(problem.body.max_tilt_rad + turn))


def near_goal(problem: Problem, before_s: float = 0.0) -> Problem:
    """The same with no more tilt than within the goal's tolerance, or so long before."""
    body = problem.body
    fastest = body.fastest_yaw_rad_s + (1.0 - np.cos(body.max_tilt_rad)) * body.max_rate_rad_s  # the roll's
    tilt = float(np.abs(problem.goal.body.rpy_rad[:2]).max()) + _goal_angle(problem) + fastest * before_s
    return replace(problem, body=replace(body, max_tilt_rad=min(tilt + 1e-3, body.max_tilt_rad)))


class RelaxedReach:
    """Bounds of body positions with `grips`, the wrists' (`Grip.raised`), in reach: at all headings, at the goal."""

    def __init__(self, problem: Problem, grips: list[Grip]) -> None:
        self.problem, self.grips = problem, grips
        goal, body = problem.goal, problem.body
        heights = np.array([g.height_m for g in grips]).reshape(-1, 2)
        self._middle_m = float(heights.min() + heights.max()) / 2 if len(grips) else 0.0
        self._spread_m = float(np.ptp(heights)) / 2 if len(grips) else 0.0
        self._over_m = np.array([body.height_m[0] - TOLERANCE_M, body.height_m[1] + TOLERANCE_M]) - self._middle_m
        self.shift_m = float(np.sin(body.max_tilt_rad + 1e-3) * np.abs(self._over_m).max())
        yaw = float(goal.body.rpy_rad[2])
        most = (abs(yaw) + _goal_angle(problem) + body.fastest_yaw_rad_s * problem.steps * problem.dt_s) / 2
        self.all = self._headings(problem, -most, most, BIN_RAD)
        self.hop = int(np.ceil(body.fastest_yaw_rad_s * problem.dt_s / self.bin_rad)) + 1
        slack = _goal_angle(problem) + 1e-3
        self.goal = self._headings(near_goal(problem), yaw - slack, yaw + slack, GOAL_BIN_RAD)
        self.at_goal_yaw: Flags = np.abs(self.all.yaw_rad - yaw) <= slack + self.bin_rad
        self._goal_low, self._goal_high = self._goal_soles(slack)

    @property
    def bin_rad(self) -> float:
        """Width of the bins of yaw."""
        yaws = self.all.yaw_rad
        return float(yaws[1] - yaws[0]) if len(yaws) > 1 else BIN_RAD

    def _headings(self, problem: Problem, first: float, last: float, width: float) -> Headings:
        yaws, half = _bins(first, last, width)
        boxes, tilt = problem.boxes, problem.body.max_tilt_rad + 1e-3
        arm = np.abs(boxes.centre_b_m).max(axis=0) + boxes.half_m  # |u|, and of q:
        arm = (arm + self.shift_m + tilt**2 * arm.max()) / np.cos(tilt)
        second = tilt**2 * np.array([arm[0] / 2, arm[1] / 2 + arm[0]]) + tilt * self._spread_m
        slack = second + half * arm[[1, 0]] + half**2 / 2 * arm[:2] + TOLERANCE_M
        to_h = rotation_z(yaws)
        count = len(self.grips)
        centres = np.array([g.contact.centre_h_m for g in self.grips]).reshape(count, 3) @ to_h  # (B, G, 3)
        tangents = np.abs(np.array([g.contact.tangent for g in self.grips]).reshape(count, 3) @ to_h)[..., :2]
        aside = np.array([g.aside_m for g in self.grips])[:, None] * np.minimum(tangents + half, 1.0)
        reach = (boxes.half_m[:2] + slack + aside)[:, None]  # (B, 1, G, 2)
        middle = centres[:, None, :, :2] - boxes.centre_b_m[:, None, :2]  # (B, 4, G, 2)
        return Headings(yaws, to_h, middle - reach, middle + reach)

    def _goal_soles(self, slack_rad: float) -> tuple[Array, Array]:
        """Bounds (B, 2) of the sole at the goal's bins of yaw."""
        goal, most = self.problem.goal, self.problem.body.max_tilt_rad + 1e-3
        tilt = np.clip(goal.body.rpy_rad[:2, None] + [-slack_rad, slack_rad], -most, most)  # (2, 2)
        over = np.outer([1.0, np.cos(most)], self._over_m)
        roll, pitch = (np.sort(np.outer(np.sin(t), over).ravel())[[0, -1]] for t in tilt)
        # q moves by (sin pitch, -sin roll cos pitch) h against the boxes: the sole goes the other way
        low, high = np.array([-pitch[1], roll[0]]), np.array([-pitch[0], roll[1]])
        place = np.einsum("bji,j->bi", self.goal.to_h, goal.body.position_m)[:, :2]
        within = goal.tolerance_m + TOLERANCE_M
        return place + low - within, place + high + within

    def at_goal(self, stances: Array) -> Flags:
        """(S,) whether all grips of stances (S, 4) are in reach of one heading and sole at the goal."""
        limbs = np.arange(4)
        possible = np.zeros(len(stances), dtype=bool)
        for i in range(len(self.goal.yaw_rad)):
            rest = np.flatnonzero(~possible)
            low = np.maximum(self.goal.low[i, limbs, stances[rest]].max(axis=1), self._goal_low[i])
            high = np.minimum(self.goal.high[i, limbs, stances[rest]].min(axis=1), self._goal_high[i])
            possible[rest] = (low <= high).all(axis=1)
        return possible

    def beyond_goal(self, limb: int) -> Array:
        """(G,) how far each grip is out of a limb's reach at the goal, at the best heading; not positive: not."""
        low, high = self.goal.low[:, limb], self.goal.high[:, limb]
        beyond = np.maximum(low - self._goal_high[:, None], self._goal_low[:, None] - high)
        return np.asarray(beyond.max(axis=2).min(axis=0))

    def in_reach(self, limb: int, position_m: Array, most_turn_rad: float) -> Flags:
        """(P,) whether a body at positions (P, 3), of any tilt, has some grip in reach of a limb.

        It may be turned by no more than `most_turn_rad` beyond the headings of start and goal.
        """
        yaw, ends = self.all.yaw_rad, sorted((0.0, float(self.problem.goal.body.rpy_rad[2])))
        bins = (yaw >= ends[0] - most_turn_rad) & (yaw <= ends[1] + most_turn_rad)
        place = np.einsum("bji,pj->bpi", self.all.to_h[bins], position_m)[:, :, None, :2]  # (B, P, 1, 2)
        low, high = self.all.low[bins, None, limb] - self.shift_m, self.all.high[bins, None, limb] + self.shift_m
        return np.asarray(((place >= low) & (place <= high)).all(axis=3).any(axis=(0, 2)))

    def hull(self, stance: tuple[int, ...]) -> tuple[Array, Array] | None:
        """Bounds along H's axes of all body positions with a stance's grips in reach (-1: air), None if none."""
        fits, low, high = self.all.fits(stance)
        return self.region(fits, low, high) if fits.any() else None

    def region(self, bins: Flags, low: Array, high: Array) -> tuple[Array, Array]:
        """Bounds along H's axes of body positions whose soles are in [low, high] (B, 2) at these headings."""
        middle, half = (low[bins] + high[bins]) / 2, (high[bins] - low[bins]) / 2
        turn = np.abs(self.all.to_h[bins, :2, :2])
        centre = (self.all.to_h[bins, :2, :2] @ middle[..., None])[..., 0]
        extent = (turn @ (half + self.shift_m)[..., None])[..., 0]
        height = self._over_m + self._middle_m
        lowest, highest = (centre - extent).min(axis=0), (centre + extent).max(axis=0)
        return np.append(lowest, height[0]), np.append(highest, height[1])


class RelaxedBalance:
    """How much force balance lacks at least, at the very limit of (2)+(3)."""

    def __init__(self, problem: Problem, grips: list[Grip]) -> None:
        self.problem, self.grips = problem, grips
        contacts = [g.contact for g in grips]
        # of a point mass, so that its positions are the centre of mass's
        point = replace(problem, contacts=contacts, limb_masses=(), body_moment_kg_m=np.zeros(3))
        self.centred = StaticEquilibrium(point, 1.0)
        k = problem.patch.k_m
        self.directions, _ = polytope_directions(k)
        self.surface = np.linalg.norm(self.directions * [1.0, 1.0, k], axis=1)  # support of the unit ball
        yaw = abs(float(problem.goal.body.rpy_rad[2])) + _goal_angle(problem)
        yaw += problem.body.fastest_yaw_rad_s * problem.steps * problem.dt_s / 2
        self.spans = gripper_spans(problem)
        self.offset = offset_bounds(problem, self.spans, yaw)  # of the centre of mass from the body's origin
        offset_m, arm_m = (float(np.linalg.norm(np.abs(ends).max(axis=(0, 1)))) for ends in ([self.offset], self.spans))
        self.slack_N = _slack(problem, offset_m, arm_m)

    def missing_at_goal(self, stance: tuple[int, ...], low: Array, high: Array) -> float:
        """`missing_force` of a body in [low, high] a knot before its goal, by limbs (-1: air) in known places."""
        problem = near_goal(self.problem, self.problem.dt_s)
        goal = problem.goal
        slack = _goal_angle(self.problem) + problem.body.fastest_yaw_rad_s * problem.dt_s + 1e-3
        yaw = float(goal.body.rpy_rad[2])
        lowest, highest = problem.body.height_m
        low = np.append(low[:2], max(low[2], lowest - TOLERANCE_M))
        high = np.append(high[:2], min(high[2], highest + TOLERANCE_M))
        lows, highs = self.spans[0].copy(), self.spans[1].copy()
        for limb, g in enumerate(stance):
            if g >= 0:
                places = np.array(self._places(self.grips[g]))
                first, last = places.min(axis=0) - high - TOLERANCE_M, places.max(axis=0) - low + TOLERANCE_M
                near = in_heading(first, last, (yaw - slack, yaw + slack))
                lows[limb], highs[limb] = np.maximum(lows[limb], near[0]), np.minimum(highs[limb], near[1])
        if (lows > highs).any():
            return np.inf  # out of reach
        offset = offset_bounds(problem, (lows, highs), abs(yaw) + slack)
        return self.least_missing(tuple(g for g in stance if g >= 0), low + offset[0], high + offset[1])[0]

    def place(self, support: tuple[int, ...], low: Array, high: Array) -> Array | None:
        """A body position in [low, high] with balance on `support`, by all that is shown; None is a proof of none.

        The centre of mass is anywhere about the body's origin where the limbs may have it.
        """
        about = low + self.offset[0], high + self.offset[1]
        centre = self.centred.position(support, *about, (about[0] + about[1]) / 2)
        if centre is None:
            lacking, centre, _ = self.least_missing(support, *about)
            if lacking > 0.0:
                return None
        return np.clip(centre - (self.offset[0] + self.offset[1]) / 2, low, high)

    def missing_force(self, support: tuple[int, ...], low: Array, high: Array) -> float:
        """Least force [N] that balance lacks beyond what accelerations may explain (moments over `MOMENT_ARM_M`)."""
        return self.least_missing(support, low + self.offset[0], high + self.offset[1])[0]

    def least_missing(self, support: tuple[int, ...], low: Array, high: Array) -> tuple[float, Array, Array]:
        """`missing_force` with the centre of mass in [low, high], where it is least, and the multipliers of
        force and moment about the origin that show it.
        """
        middle = np.mean([self.grips[g].contact.centre_h_m for g in support], axis=0)
        about = np.block([[np.eye(3), np.zeros((3, 3))], [-skews(middle), np.eye(3)]])
        about[3:] /= MOMENT_ARM_M
        places = [(i, centre) for i, g in enumerate(support) for centre in self._places(self.grips[g])]
        n = 3 + 6 * len(places)  # of each place: s1, s2, m, F, n and its share of the grip
        matrix = np.zeros((6, n))
        matrix[3:, :3] = -skews(self.problem.weight_N)
        shares = np.zeros((len(support), n))
        most, blocks = np.full(2, self.problem.patch.max_normal_N), []
        for j, (i, centre) in enumerate(places):
            contact = self.grips[support[i]].contact
            at = 3 + 6 * j
            matrix[:, at : at + 4] = static_map(centre, contact.axis, contact.tangent)
            shares[i, at + 5] = 1.0
            limits, right = grip_rows(self.centred.limits[support[i]], self.directions, self.surface, most)
            blocks.append(np.hstack([limits, -right[:, None]]))
        rows = np.hstack([np.zeros((sum(map(len, blocks)), 3)), block_diagonal(blocks)])
        wrench = np.array([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N, 1.0])
        upper = np.concatenate([high, np.tile(wrench, len(places))])
        lower = np.concatenate([low, np.tile(-wrench, len(places))])
        lower[7::6] = lower[8::6] = 0.0
        weighted = about @ matrix
        target = about @ np.concatenate([-self.problem.weight_N, np.zeros(3)])
        cost = weighted.T @ weighted + 1e-9 * np.eye(n)
        for _ in range(_ROUNDS):
            mixed, below = (shares, np.ones(len(support))), (rows, None, np.zeros(len(rows)))
            qp = Qp(cost, -weighted.T @ target, mixed, below, lower, upper, eps_abs=1e-6, max_iter=200)
            if not (solution := qp.solve()).solved:
                return 0.0, (low + high) / 2, np.zeros(6)  # nothing shown
            found, lacking = solution.x, target - weighted @ solution.x
            missing = qp.constraints.shown_distance(weighted, target, solution) - self.slack_N
            cuts = [] if missing > 0.0 else self._cuts(support, [i for i, _ in places], found)
            if not cuts:
                break
            rows = np.vstack([rows, *cuts])
        return missing, np.clip(found[:3], low, high), about.T @ lacking

    def _cuts(self, support: tuple[int, ...], which: list[int], found: Array) -> list[Array]:
        """Tangents of (2)+(3), as rows, at wrenches found outside it; `which` has each place's grip in `support`."""
        k, cuts = self.problem.patch.k_m, []
        for j, i in enumerate(which):
            at = 3 + 6 * j
            s1, s2, m, net, normal, share = found[at : at + 6]
            load = np.array([s1, s2, m / k])
            for side, friction, spines, _ in self.centred.limits[support[i]]:
                spine = spines / [1.0, 1.0, k]
                beyond = load - np.clip(load, -share * spine, share * spine)  # what friction has to carry
                size = float(np.linalg.norm(beyond))
                if size > friction * (normal + side / 2 * net) + _CUT_N:
                    way = beyond / size
                    row = np.zeros(len(found))
                    row[at : at + 3] = way / [1.0, 1.0, k]
                    row[at + 3 : at + 6] = -side / 2 * friction, -friction, -np.abs(way) @ spine
                    cuts.append(row)
        return cuts

    def _places(self, grip: Grip) -> list[Array]:
        """Corners of the rectangle in which the grasp's centre may lie: wrenches anywhere in it are mixtures."""
        contact = grip.contact
        sides = (-grip.aside_m, grip.aside_m) if grip.aside_m > 0 else (0.0,)
        heights = grip.height_m if grip.height_m[1] > grip.height_m[0] else grip.height_m[:1]
        middle = contact.centre_h_m * [1.0, 1.0, 0.0]
        return [middle + side * contact.tangent + np.array([0.0, 0.0, z]) for side in sides for z in heights]


def _slack(problem: Problem, offset_m: float, arm_m: float) -> float:
    """Force [N] that the changes of speed and rate within (7) may ask for, in the norm of `missing_force`; the centre
    of mass is up to `offset_m` off the body's origin, grippers up to `arm_m`.
    """
    force = problem.mass_kg * 2 * problem.body.max_speed_m_s / problem.dt_s * 3**0.5
    spin = _INERTIA_SHARE * float(np.linalg.eigvalsh(problem.inertia_b).max())
    spin *= 2 * problem.body.max_rate_rad_s / problem.dt_s * 3**0.5 + 3 * problem.body.max_rate_rad_s**2
    return float(np.hypot(force, (spin + (arm_m + offset_m) * force) / MOMENT_ARM_M)) + 0.05


def _bins(low: float, high: float, width: float) -> tuple[Array, float]:
    """Middles of bins no wider than `width`, and half their width."""
    count = max(1, int(np.ceil((high - low) / width)))
    edges = np.linspace(low, high, count + 1)
    return (edges[1:] + edges[:-1]) / 2, (high - low) / (2 * count)
