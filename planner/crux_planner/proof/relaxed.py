"""What every plan satisfies, whatever its headings, tilts, off-centre grasps and swings: an optimistic P1.

Reach: the acceptance boxes (9a), widened by all that the body's tilt, a range of headings and a grasp's place on its
face may change. Balance: the whole limit surface (2)+(3), from outside by a polytope; grasps anywhere on their faces;
what accelerations within the bounds (7) may add. No swings, no collisions, no torques.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import piqp

from crux_planner.arrays import Array, Flags
from crux_planner.contacts import Contact
from crux_planner.kinematics import rotation_z
from crux_planner.problem import Problem
from crux_planner.search.balance import FORCE_BOUND_N, MOMENT_ARM_M, TWIST_BOUND_NM, Balance
from crux_planner.terms.dynamics import skew, static_map
from crux_planner.terms.limit_surface import polytope_directions

BIN_RAD = 0.1
TOLERANCE_M = 1e-3  # more than the check forgives, and than the solvers' rounding
_ARM_RESERVE_M = 0.03  # by which tilt lengthens the arms that a turn moves
_EULER_SHARE = 1.07  # yaw rates exceed the body's rates by no more, at the largest tilt
_INERTIA_SHARE = 3.0  # the inertia at any posture against that at the start


@dataclass(frozen=True)
class Grip:
    """A hold and a face pair; the grasp may be `aside_m` to each side of the middle and anywhere in `height_m`."""

    contact: Contact
    aside_m: float
    height_m: tuple[float, float]


@dataclass(frozen=True)
class Bounds:
    """Body positions (4, G, 3) with a grip in reach of a limb, along axes turned by `yaw_rad`."""

    yaw_rad: float
    low: Array
    high: Array


class RelaxedReach:
    """Bounds of body positions over all headings of a plan, and at the goal."""

    def __init__(self, problem: Problem, grips: list[Grip]) -> None:
        self.problem, self.grips = problem, grips
        goal, body = problem.goal, problem.body
        yaw = float(goal.body.rpy_rad[2])
        duration = problem.steps * problem.dt_s
        turn = (abs(yaw) + goal.tolerance_rad + _EULER_SHARE * body.max_rate_rad_s * duration) / 2
        count = max(1, int(np.ceil(2 * turn / BIN_RAD)))
        edges = np.linspace(-turn, turn, count + 1)
        half = turn / count
        self.bins = [self.bounds(float(mid), half, body.max_tilt_rad) for mid in (edges[1:] + edges[:-1]) / 2]
        tilt = min(body.max_tilt_rad, float(np.abs(goal.body.rpy_rad[:2]).max()) + goal.tolerance_rad)
        self.at_goal = self.bounds(yaw, _EULER_SHARE * goal.tolerance_rad, tilt)
        self._low = np.stack([b.low for b in self.bins])  # (B, 4, G, 3)
        self._high = np.stack([b.high for b in self.bins])
        self._to_w = rotation_z(np.array([b.yaw_rad for b in self.bins]))

    def bounds(self, yaw_rad: float, turn_rad: float, tilt_rad: float) -> Bounds:
        """For every heading within `turn_rad` of `yaw_rad` and every roll and pitch up to `tilt_rad`."""
        boxes, height = self.problem.boxes, self.problem.body.height_m
        arm = np.abs(boxes.centre_b_m).max(axis=0) + boxes.half_m + _ARM_RESERVE_M
        s, c = np.sin(turn_rad), 1.0 - np.cos(turn_rad)
        turned = np.array([s * arm[1] + c * arm[0], s * arm[0] + c * arm[1], 0.0])
        s, c = np.sin(tilt_rad), 1.0 - np.cos(tilt_rad)
        lifted = s * (arm[0] + arm[1]) + arm[2]  # |z| of a gripper in the tilted body
        tilted = np.array([c * arm[0] + s * lifted, c * arm[1] + s * lifted, s * (arm[0] + arm[1]) + 2 * c * lifted])
        to = rotation_z(-yaw_rad)
        centres = np.array([g.contact.centre_w_m for g in self.grips]) @ to.T
        tangents = np.abs(np.array([g.contact.tangent for g in self.grips]) @ to.T)
        tangents[:, :2] += s + np.sin(turn_rad)
        aside = np.array([g.aside_m for g in self.grips])[:, None] * tangents
        aside[:, 2] = [np.ptp(g.height_m) for g in self.grips]
        half = boxes.half_m + turned + tilted + TOLERANCE_M + aside  # (G, 3)
        low = centres - boxes.centre_b_m[:, None] - half
        high = centres - boxes.centre_b_m[:, None] + half
        low[..., 2] = np.maximum(low[..., 2], height[0] - TOLERANCE_M)
        high[..., 2] = np.minimum(high[..., 2], height[1] + TOLERANCE_M)
        return Bounds(yaw_rad, low, high)

    def hull(self, stance: tuple[int, ...]) -> tuple[Array, Array] | None:
        """Bounds along W's axes of all body positions with a stance's grips in reach (-1: air), None if none."""
        on = [(limb, g) for limb, g in enumerate(stance) if g >= 0]
        limbs, grips = [limb for limb, _ in on], [g for _, g in on]
        low, high = self._low[:, limbs, grips].max(axis=1), self._high[:, limbs, grips].min(axis=1)
        fits: Flags = (low <= high).all(axis=1)
        if not fits.any():
            return None
        middle, half = (low[fits] + high[fits]) / 2, (high[fits] - low[fits]) / 2
        to_w = self._to_w[fits]
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
