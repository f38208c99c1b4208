"""What every plan satisfies, whatever its headings, tilts, off-centre grasps and swings: an optimistic P1.

Reach: the acceptance boxes (9a), widened by all that the body's tilt, a range of headings and a grasp's place on its
face may change. Balance: the whole limit surface (2)+(3), from outside by a polytope; grasps anywhere on their faces;
what accelerations within the bounds (7) may add. No swings, no collisions, no torques.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import piqp

from crux_planner.arrays import Array, Flags
from crux_planner.contacts import Contact
from crux_planner.kinematics import rotation_from_rpy
from crux_planner.problem import Problem
from crux_planner.search.balance import FORCE_BOUND_N, MOMENT_ARM_M, TWIST_BOUND_NM, Balance
from crux_planner.terms.dynamics import skew, static_map
from crux_planner.terms.limit_surface import polytope_directions

BIN_RAD = 0.1
GOAL_LEVELS = 4  # times that a bin of the goal's orientation is halved
TOLERANCE_M = 1e-3  # more than the check forgives, and than the solvers' rounding
_COUPLING = 1.1  # roll, pitch and yaw are no rotation vector; tilts stay below 0.1 rad
_FAR_M = 10.0  # from W's origin
_EULER_SHARE = 1.07  # yaw rates exceed the body's rates by no more, at the largest tilt
_INERTIA_SHARE = 3.0  # the inertia at any posture against that at the start


@dataclass(frozen=True)
class Grip:
    """A hold and a face pair; the grasp may be `aside_m` to each side of the middle and anywhere in `height_m`."""

    contact: Contact
    aside_m: float
    height_m: tuple[float, float]


class RelaxedReach:
    """Bounds of body positions, by bins of orientation: over all orientations of a plan, and at the goal.

    `low`, `high` (B, 4, G, 3) are along a body's axes in the middle of each bin, `to_w` (B, 3, 3) turns them to W.
    """

    def __init__(self, problem: Problem, grips: list[Grip]) -> None:
        self.problem, self.grips = problem, grips
        goal, body = problem.goal, problem.body
        yaw = float(goal.body.rpy_rad[2])
        duration = problem.steps * problem.dt_s
        turn = (abs(yaw) + goal.tolerance_rad + _EULER_SHARE * body.max_rate_rad_s * duration) / 2
        yaws, half = _bins(-turn, turn, BIN_RAD)
        tilt = body.max_tilt_rad
        self.to_w, self.low, self.high = self._bounds(np.outer(yaws, [0.0, 0.0, 1.0]), np.array([tilt, tilt, half]))
        self.goal_to_w, self.goal_low, self.goal_high = self._goal_bounds()
        self.goal_place = np.einsum("bji,j->bi", self.goal_to_w, goal.body.position_m)

    def _goal_bounds(self) -> tuple[Array, Array, Array]:
        """Bins of orientation at the goal, made finer where every limb has a hold in reach."""
        goal, most = self.problem.goal, self.problem.body.max_tilt_rad
        room = _EULER_SHARE * goal.tolerance_rad + 1e-6
        middles, half = np.zeros((1, 3)), room
        for level in range(GOAL_LEVELS + 1):
            inside = np.linalg.norm(middles, axis=1) <= room + half * 3**0.5
            inside &= (np.abs(goal.body.rpy_rad[:2] + middles[:, :2]) <= most + half).all(axis=1)
            bounds = self._bounds(goal.body.rpy_rad + middles[inside], np.full(3, half))
            place = np.einsum("bji,j->bi", bounds[0], goal.body.position_m)[:, None, None]
            within = goal.tolerance_m + TOLERANCE_M
            reached = ((bounds[1] <= place + within) & (bounds[2] >= place - within)).all(axis=3)
            useful = reached.any(axis=2).all(axis=1)
            if level == GOAL_LEVELS or not useful.any():
                break
            half /= 2
            corners = half * np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
            middles = (middles[inside][useful][:, None] + corners).reshape(-1, 3)
        return bounds

    def _bounds(self, rpys: Array, half_rpy: Array) -> tuple[Array, Array, Array]:
        """For every orientation within `half_rpy` of each of `rpys`, in roll, pitch and yaw."""
        boxes, height = self.problem.boxes, self.problem.body.height_m
        arm = np.abs(boxes.centre_b_m).max(axis=0) + boxes.half_m
        roll, pitch, yaw = _COUPLING * half_rpy
        # A rotation by a small vector moves a point by their cross product, and by terms of second order.
        turned = np.array([yaw * arm[1] + pitch * arm[2], yaw * arm[0] + roll * arm[2], roll * arm[1] + pitch * arm[0]])
        turned += (roll + pitch + yaw) ** 2 / 2 * np.linalg.norm(arm)
        to_w = rotation_from_rpy(rpys)  # (B, 3, 3)
        centres = np.array([g.contact.centre_w_m for g in self.grips]) @ to_w  # (B, G, 3)
        tangents = np.abs(np.array([g.contact.tangent for g in self.grips]) @ to_w) + roll + pitch + yaw
        aside = np.array([g.aside_m for g in self.grips])[:, None] * np.minimum(tangents, 1.0)
        aside += np.array([np.ptp(g.height_m) / 2 for g in self.grips])[:, None] * np.array([0.1, 0.1, 1.0])
        half = boxes.half_m + turned + TOLERANCE_M + aside[:, None]  # (B, 1, G, 3)
        middle = centres[:, None] - boxes.centre_b_m[:, None]  # (B, 4, G, 3)
        low, high = middle - half, middle + half
        lean = (_COUPLING * self.problem.body.max_tilt_rad) * 2 * _FAR_M  # heights along tilted axes are no heights
        tilted = float(np.abs(rpys[:, :2]).max(initial=0.0)) > 0.0
        low[..., 2] = np.maximum(low[..., 2], height[0] - TOLERANCE_M - lean * tilted)
        high[..., 2] = np.minimum(high[..., 2], height[1] + TOLERANCE_M + lean * tilted)
        return to_w, low, high

    def at_goal(self, stances: Array) -> Flags:
        """(S,) whether all grips of stances (S, 4) are in reach of one orientation and position at the goal."""
        limbs = np.arange(4)
        room, place = self.problem.goal.tolerance_m + TOLERANCE_M, self.goal_place
        possible = np.zeros(len(stances), dtype=bool)
        for low, high, at in zip(self.goal_low, self.goal_high, place, strict=True):
            most_low = np.maximum(low[limbs, stances].max(axis=1), at - room)
            possible |= (most_low <= np.minimum(high[limbs, stances].min(axis=1), at + room)).all(axis=1)
        return possible

    def beyond_goal(self, limb: int) -> Array:
        """(G,) how far each grip is out of a limb's reach at the goal, in the best orientation; not positive: not."""
        room, place = self.problem.goal.tolerance_m + TOLERANCE_M, self.goal_place[:, None]
        beyond = np.maximum(self.goal_low[:, limb] - room - place, place - room - self.goal_high[:, limb])
        least: Array = beyond.max(axis=2).min(axis=0)
        return least

    def hull(self, stance: tuple[int, ...]) -> tuple[Array, Array] | None:
        """Bounds along W's axes of all body positions with a stance's grips in reach (-1: air), None if none."""
        on = [(limb, g) for limb, g in enumerate(stance) if g >= 0]
        limbs, grips = [limb for limb, _ in on], [g for _, g in on]
        low, high = self.low[:, limbs, grips].max(axis=1), self.high[:, limbs, grips].min(axis=1)
        fits: Flags = (low <= high).all(axis=1)
        if not fits.any():
            return None
        middle, half = (low[fits] + high[fits]) / 2, (high[fits] - low[fits]) / 2
        to_w = self.to_w[fits]
        centre = (to_w @ middle[..., None])[..., 0]
        extent = (np.abs(to_w) @ half[..., None])[..., 0]
        return (centre - extent).min(axis=0), (centre + extent).max(axis=0)


class RelaxedBalance:
    """How much force balance lacks at least, at the very limit of (2)+(3)."""

    def __init__(self, problem: Problem, grips: list[Grip]) -> None:
        self.problem, self.grips = problem, grips
        self.centred = Balance(replace(problem, contacts=[g.contact for g in grips]), 1.0)
        k = problem.patch.k_m
        self.directions, _, spine = polytope_directions(k)
        self.surface = np.linalg.norm(self.directions * [1.0, 1.0, k], axis=1)  # support of the unit ball
        self.spine = spine
        self.slack_N = _slack(problem)

    def possible(self, support: tuple[int, ...], low: Array, high: Array) -> bool:
        """Whether balance may exist on the grips `support` for a body in [low, high]; False is a proof."""
        if not support:
            return False
        if self.centred.position(support, low, high, (low + high) / 2) is not None:
            return True
        return self.missing_force(support, low, high) <= 0.0

    def missing_force(self, support: tuple[int, ...], low: Array, high: Array) -> float:
        """Least force [N] that balance lacks beyond what accelerations may explain (moments over `MOMENT_ARM_M`)."""
        middle = np.mean([self.grips[g].contact.centre_w_m for g in support], axis=0)
        about = np.block([[np.eye(3), np.zeros((3, 3))], [-skew(middle), np.eye(3)]])
        about[3:] /= MOMENT_ARM_M
        places = [(i, centre) for i, g in enumerate(support) for centre in self._places(self.grips[g])]
        n = 3 + 6 * len(places)  # of each place: s1, s2, m, F, n and its share of the grip
        matrix = np.zeros((6, n))
        matrix[3:, :3] = -skew(self.problem.weight_N)
        shares = np.zeros((len(support), n))
        rows = np.zeros((len(places) * (len(self.surface) + 2), n))
        step = len(self.surface) + 2
        for j, (i, centre) in enumerate(places):
            contact = self.grips[support[i]].contact
            at = 3 + 6 * j
            matrix[:, at : at + 4] = static_map(centre, contact.axis, contact.tangent)
            shares[i, at + 5] = 1.0
            block = rows[j * step : (j + 1) * step, at : at + 6]
            block[:-2, :3] = self.directions
            block[:-2, 4] = -self.surface * contact.friction
            block[:-2, 5] = -self.spine @ [contact.spine_shear_N, contact.spine_shear_N, contact.spine_twist_Nm]
            block[-2:, 3:] = [
                [1.0, 1.0, -self.problem.patch.max_normal_N],
                [-1.0, 1.0, -self.problem.patch.max_normal_N],
            ]
        wrench = np.array([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N, 1.0])
        upper = np.concatenate([high, np.tile(wrench, len(places))])
        lower = np.concatenate([low, np.tile(-wrench, len(places))])
        lower[7::6] = lower[8::6] = 0.0
        weighted = about @ matrix
        target = about @ np.concatenate([-self.problem.weight_N, np.zeros(3)])
        solver = piqp.DenseSolver()
        solver.settings.verbose = False
        solver.settings.eps_abs, solver.settings.max_iter = 1e-6, 200
        cost = weighted.T @ weighted + 1e-9 * np.eye(n)
        solver.setup(
            cost, -weighted.T @ target, shares, np.ones(len(support)), rows, None, np.zeros(len(rows)), lower, upper
        )
        if solver.solve() != piqp.PIQP_SOLVED:
            return 0.0  # nothing shown
        return float(np.linalg.norm(weighted @ np.array(solver.result.x) - target)) - self.slack_N

    def _places(self, grip: Grip) -> list[Array]:
        """Corners of the rectangle in which the grasp's centre may lie: wrenches anywhere in it are mixtures."""
        contact = grip.contact
        sides = (-grip.aside_m, grip.aside_m) if grip.aside_m > 0 else (0.0,)
        heights = grip.height_m if grip.height_m[1] > grip.height_m[0] else grip.height_m[:1]
        middle = contact.centre_w_m * [1.0, 1.0, 0.0]
        return [middle + side * contact.tangent + np.array([0.0, 0.0, z]) for side in sides for z in heights]


def _slack(problem: Problem) -> float:
    """Force [N] that the changes of speed and rate within (7) may ask for, in the norm of `missing_force`."""
    force = problem.mass_kg * 2 * problem.body.max_speed_m_s / problem.dt_s * 3**0.5
    arm = float(np.linalg.norm(np.abs(problem.boxes.centre_b_m).max(axis=0) + problem.boxes.half_m))
    spin = _INERTIA_SHARE * float(np.linalg.eigvalsh(problem.inertia_b).max())
    spin *= 2 * problem.body.max_rate_rad_s / problem.dt_s * 3**0.5 + 3 * problem.body.max_rate_rad_s**2
    return float(np.hypot(force, (spin + arm * force) / MOMENT_ARM_M)) + 0.05


def _bins(low: float, high: float, width: float) -> tuple[Array, float]:
    """Middles of bins no wider than `width`, and half their width."""
    count = max(1, int(np.ceil((high - low) / width)))
    edges = np.linspace(low, high, count + 1)
    return (edges[1:] + edges[:-1]) / 2, (high - low) / (2 * count)
