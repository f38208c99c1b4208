"""What grips bear at most, and that what some grips bear cannot carry the robot: shown by multipliers.

For multipliers pi = (pi_F, pi_M) of force and moment about W's origin, balance of the grips' wrenches w with the
robot's weight and inertia asks for
    sum pi . w = pi_F . M (a - g) + pi_M . (c x M (a - g) + I alpha + omega x I omega).
Where the most that the left side can be is less than the least of the right one, there is no balance. Any pi will do.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.checker.geometry import Array
from crux_planner.checker.outer import FOLLOW, FORGIVEN_M, Outer

FORGIVEN_N, FORGIVEN_NM = 0.03, 0.003  # more than tolerances.py
AIR_N, _AIR_NM = 0.022, 0.003  # the same of both fingers of a limb in the air
SLACK_N, SLACK_NM = 0.02, 6e-4  # of each finger's load and twist
_OFF_M = 1.5e-4  # of fingers off their places
_SPLITS = np.linspace(0.0, 1.0, 9)  # of a grip's load on finger 1: any of them bounds what both bear


@dataclass(frozen=True)
class Offer:
    """Two faces of a hold: the centre of a grasp is anywhere in a rectangle, by its corners (c, 3)."""

    name: tuple[str, str]  # hold, faces
    corners_w_m: Array
    axis: Array
    tangent: Array
    friction: Array  # (2,)
    spines: Array  # (2, 3) in (s1, s2, m / k) [N]

    def raised(self, by_m: float) -> Array:
        """The corners so much further off the wall."""
        return np.asarray(self.corners_w_m + np.array([0.0, 0.0, by_m]))

    def forgiven(self, k_m: float, most_N: float) -> tuple[Array, float]:
        """What the check lets each finger bear beyond its limit surface (2,) [N], and the grip in moment [Nm]."""
        bears = self.friction.min() * most_N + self.spines.max(axis=0)[:2].sum()
        return SLACK_N * (1.0 + self.friction) + SLACK_NM / k_m, float(FORGIVEN_NM + 2 * _OFF_M * (bears + most_N))


def offers(scenario: Scenario, robot: Robot) -> list[Offer]:
    """All that the gripper spans."""
    found, contact, (least, most) = [], scenario.contact, robot.gripper.opening_m
    radius, k_m = contact.patch_radius_m, contact.patch_k_m
    spine = np.array([contact.spine_shear_N, contact.spine_shear_N, contact.spine_twist_Nm / k_m])
    for hold in scenario.holds:
        low = max(robot.grasp.pad_height_m[0], radius) - FORGIVEN_M
        high = min(robot.grasp.pad_height_m[1], hold.size_m[2] - radius) + FORGIVEN_M
        for pair, faces in enumerate("xy"):
            aside, width = hold.size_m[1 - pair] / 2 - radius + FORGIVEN_M, hold.size_m[pair]
            if low > high or aside < 0.0 or not 2 * (least - FORGIVEN_M) <= width <= 2 * (most + FORGIVEN_M):
                continue
            yaw = hold.yaw_rad + pair * np.pi / 2
            axis, tangent = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([-np.sin(yaw), np.cos(yaw), 0.0])
            foot, ends = np.array([*hold.position_m, 0.0]), itertools.product((-aside, aside), (low, high))
            corners = np.array([foot + side * tangent + [0.0, 0.0, z] for side, z in ends])
            which = [2 * pair, 2 * pair + 1]
            spines = np.outer([hold.spines[face] for face in which], spine)
            friction = np.array([hold.friction[face] for face in which])
            found.append(Offer((hold.name, faces), corners, axis, tangent, friction, spines))
    return found


@dataclass(frozen=True)
class Frame:
    """Where the mass and the wrists of limbs in the air may be off the body, along W's axes, for headings about one."""

    ends_m: Array  # (13, 2, 3): the body's share in the mass, limbs' that hold, limbs' in the air, their wrists

    @staticmethod
    def of(outer: Outer, yaw_rad: float, within_rad: float) -> Frame:
        """For all headings within so much."""
        ends = np.concatenate([outer.body_m[None], outer.hold_rest_m, outer.swing_rest_m, outer.swing_m])
        c, s, more = np.cos(yaw_rad), np.sin(yaw_rad), np.sin(min(within_rad, np.pi / 2)) + 1.0 - np.cos(within_rad)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        middle, half = ends.mean(axis=1) @ turn.T, np.ptp(ends, axis=1) / 2 @ np.abs(turn).T
        flat = more * np.linalg.norm(np.abs(ends[:, :, :2]).max(axis=1), axis=1)[:, None] * [1.0, 1.0, 0.0]
        return Frame(np.stack([middle - half - flat, middle + half + flat], axis=1))

    def rest(self, held: tuple[int, ...]) -> Array:
        """Bounds (2, 3) of the centre of mass off the body, less FOLLOW times the wrists that hold."""
        limbs = (
            self.ends_m[1 + i] if i in held else self.ends_m[5 + i] + FOLLOW * self.ends_m[9 + i] for i in range(4)
        )
        return np.asarray(self.ends_m[0] + sum(limbs))


class Balance:
    """Of one scenario."""

    def __init__(self, scenario: Scenario, robot: Robot, outer: Outer, found: list[Offer]) -> None:
        self.outer, self.offers = outer, found
        self.k_m, self.most_N = scenario.contact.patch_k_m, scenario.contact.max_normal_N * (1 + 1e-6)
        self.gravity, dt_s = np.array(scenario.wall.gravity_w_m_s2), scenario.horizon.dt_s
        speed, rate = robot.body.max_speed_m_s, robot.body.max_rate_rad_s
        self.push_N = outer.mass_kg * 3**0.5 * 2 * speed / dt_s + FORGIVEN_N
        self.twist_Nm = outer.inertia_kg_m2 * (3**0.5 * 2 * rate / dt_s + 3 * rate**2) + FORGIVEN_NM
        far = sum(map(_farthest, (outer.body_m, outer.swing_rest_m, FOLLOW * outer.swing_m)))
        self.far_m = float(np.linalg.norm(far))  # centre of mass off the body
        arm_m = max(float(np.linalg.norm(np.abs(ends).max(axis=0))) for ends in outer.swing_m) + outer.above_m
        self.air_Nm = _AIR_NM + AIR_N * arm_m  # about the body, of a limb in the air

    def most(self, offer: Offer, multipliers: Array) -> float:
        """The most that a grip adds to the left side, less its share in where the mass is."""
        force, moment = multipliers[:3], multipliers[3:]
        pull = force + np.cross(moment, offer.corners_w_m)  # (c, 3) by force at the corner
        twist = np.full(len(pull), self.k_m * moment @ offer.axis)
        load = 2 * np.column_stack([pull @ offer.tangent, pull[:, 2], twist])
        size, spread = np.linalg.norm(load, axis=1)[:, None], pull @ offer.axis
        slack_N, slack_Nm = offer.forgiven(self.k_m, self.most_N)
        total = np.zeros((len(pull), len(_SPLITS)))
        for finger, side in enumerate((1.0, -1.0)):
            share = _SPLITS if finger == 0 else 1.0 - _SPLITS
            gain = share * size * offer.friction[finger] + side * spread[:, None]
            total += self.most_N * np.maximum(gain, 0.0) + SLACK_N * np.abs(gain)
            total += share * (np.abs(load) @ offer.spines[finger] + slack_N[finger] * size[:, 0])[:, None]
        wrists = offer.raised(self.outer.above_m)
        total -= FOLLOW * (wrists @ self.slope(multipliers))[:, None]
        return float(total.max(axis=0).min() + slack_Nm * np.linalg.norm(moment))

    def slope(self, multipliers: Array) -> Array:
        """Of the right side in where the centre of mass is, (3,)."""
        return np.asarray(self.outer.mass_kg * np.cross(multipliers[3:], self.gravity))

    def refuted(self, most: float, held: tuple[int, ...], multipliers: Array, box: Array, frame: Frame) -> bool:
        """Whether the limbs `held`, whose grips add up to `most`, carry no body whose place is in a box (2, 3)."""
        slope, outer = self.slope(multipliers), self.outer
        force, moment = multipliers[:3], multipliers[3:]
        least = -outer.mass_kg * float(force @ self.gravity) + _least((1.0 - FOLLOW * len(held)) * slope, box)
        least += _least(slope, frame.rest(held))
        lever = np.linalg.norm(force + np.cross(moment, box.mean(axis=0)))
        turn = float(np.linalg.norm(moment))
        lever += turn * (float(np.linalg.norm(np.ptp(box, axis=0))) / 2 + self.far_m)
        air = 4 - len(held)
        push_N, twist_Nm = self.push_N + air * AIR_N, self.twist_Nm + air * self.air_Nm
        return bool(most < least - push_N * float(lever) - twist_Nm * turn - 1e-9)


def _least(slope: Array, ends: Array) -> float:
    """Of a linear function over a box (2, 3)."""
    return float(np.minimum(slope * ends[0], slope * ends[1]).sum())


def _farthest(ends: Array) -> Array:
    """Sum (3,) of the most that vectors within bounds (..., 2, 3) can be."""
    return np.asarray(np.abs(ends).max(axis=-2).reshape(-1, 3).sum(axis=0))
