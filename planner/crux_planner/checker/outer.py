"""Where limbs reach and where the mass is, from outside: what holds for every plan of a robot.

Wrists have all that the first three joints' own limits allow, whatever the body's tilt; a gripper is upright, so that
its wrist is straight above it. Everything is wider by more than the check forgives.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from crux_contracts.robot import Robot

from crux_planner.checker.geometry import Array, turned, turned_back
from crux_planner.checker.limb_model import Limb, load_model

FORGIVEN_M, FORGIVEN_RAD = 5e-4, 2e-3  # more than tolerances.py
FOLLOW = 0.098  # how much the centre of mass follows every wrist: any number is true, this one leaves little open
_FINE_RAD = 0.005  # between joint angles looked at; what lies between them is added


class OutsideError(ValueError):
    """The robot is not of the kind that these bounds are about."""


@dataclass(frozen=True)
class Outer:
    """Of one robot. Bounds are along the axes of the body's heading, about its origin, for any tilt."""

    above_m: float  # wrist over gripper
    hold_m: Array  # (4, 2, 3) wrists of limbs that hold about the sole (see `sole_m`), lowest and highest
    swing_m: Array  # (4, 2, 3) wrists of any limb
    body_m: Array  # (2, 3) the body's share in where the centre of mass is
    hold_rest_m: Array  # (4, 2, 3) each limb's that holds, less FOLLOW times its wrist
    swing_rest_m: Array  # (4, 2, 3) and of any limb
    sole_m: float  # along x and y: a tilt moves all wrists that hold so far at most, as if the body were there
    mass_kg: float
    inertia_kg_m2: float  # more than any about the centre of mass


class Outers:
    """Of one robot. Raises OutsideError for limbs without a spherical wrist above an upright gripper."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, load_model(robot)
        self.arms = [_arm(limb) for limb in self.model.limbs]

    def within(self, tilt: float) -> Outer:
        """For tilts up to so much."""
        robot, model, above = self.robot, self.model, self.arms[0].above_m
        low, high = robot.body.height_m[0] - FORGIVEN_M, robot.body.height_m[1] + FORGIVEN_M
        pads, top = robot.grasp.pad_height_m, robot.grasp.max_swing_height_m
        least, most = pads[0] + above - high - FORGIVEN_M, pads[1] + above - low + FORGIVEN_M
        middle, own = (pads[0] + pads[1]) / 2 + above, (pads[1] - pads[0]) / 2 + FORGIVEN_M
        follow_kg = FOLLOW * model.mass_kg
        hold = [_spans(arm, tilt, (least, most), follow_kg, own) for arm in self.arms]
        swing = [_spans(arm, tilt, (least, most + top - pads[1]), follow_kg, None) for arm in self.arms]
        body = model.body.mass_kg * model.body.com_m
        share = _tilted(np.array([body, body]), tilt) / model.mass_kg
        inertia = float(np.trace(model.body.inertia_kg_m2) + body @ body / model.body.mass_kg)
        inertia += sum(arm.mass_kg * arm.farthest_m**2 for arm in self.arms)
        sole_m = float(np.tan(tilt)) * max(abs(middle - low), abs(middle - high))
        (held, hold_rest), (swung, swing_rest) = (map(np.array, zip(*each, strict=True)) for each in (hold, swing))
        rests = hold_rest / model.mass_kg, swing_rest / model.mass_kg
        return Outer(above, held, swung, share, rests[0], rests[1], sole_m, model.mass_kg, inertia)


class _Arm:
    """A limb at all angles (n) of its second and third joint, the first at 0; moments are mass times place."""

    def __init__(self, limb: Limb) -> None:
        self.limb, some = limb, np.random.default_rng(0)
        state = limb.forward(some.uniform(limb.lower_rad, limb.upper_rad, (50, 6)), some.uniform(0.0, 0.05, 50))
        wrist, to_hand = state.joint_origin_m[:, 3], state.link_rotation[limb.gripper]
        off = turned_back(to_hand, wrist - state.link_position_m[limb.gripper])
        depth = limb._depth
        early, late = ([e for e in limb.links if (depth[e.name] > 3) == far] for far in (False, True))
        places = (state.link_position_m[e.name] + turned(state.link_rotation[e.name], e.com_m) - wrist for e in late)
        hand = np.sum([e.mass_kg * turned_back(to_hand, at) for e, at in zip(late, places, strict=True)], axis=0)
        spread = [state.joint_origin_m[:, 4:] - wrist[:, None], off - [0.0, 0.0, off[0, 2]], hand - hand[0]]
        upright = state.joint_axis[:, 0] - [0.0, 0.0, 1.0]
        if max(float(np.abs(each).max()) for each in (*spread, upright)) > 1e-9 or any(
            not depth[e.name] for e in early
        ):
            raise OutsideError(f"{limb.name} is no yawing arm with a spherical wrist straight above its gripper")
        self.above_m, self.hand = float(off[0, 2]), hand[0]
        self.origin_m, hand_kg = state.joint_origin_m[0, 0], sum(e.mass_kg for e in late)
        self.mass_kg = hand_kg + sum(e.mass_kg for e in early)
        ranges = zip(limb.lower_rad[1:3], limb.upper_rad[1:3], strict=True)
        q2, q3 = (np.linspace(a, b, int(np.ceil((b - a) / _FINE_RAD)) + 1) for a, b in ranges)
        q = np.zeros((len(q3), 6))
        q[:, 2] = q3
        state = limb.forward(q)
        (second,), bent = state.joint_origin_m[:1, 1], state.joint_origin_m[:, 3] - state.joint_origin_m[0, 1]
        turns, moment, fixed = _turns(state.joint_axis[0, 1], q2), hand_kg * bent, hand_kg * (second - self.origin_m)
        for e in early:
            at = state.link_position_m[e.name] + turned(state.link_rotation[e.name], e.com_m)
            first = depth[e.name] == 1  # not turned by the second joint
            moment = moment + (0.0 if first else e.mass_kg) * (at - second)
            fixed = fixed + e.mass_kg * (at[0] - self.origin_m if first else second - self.origin_m)
        wrist_m = second - self.origin_m + np.einsum("aij,bj->abi", turns, bent).reshape(-1, 3)
        upward = np.argsort(wrist_m[:, 2])
        self.wrist_m = wrist_m[upward]
        self.moment = fixed + np.einsum("aij,bj->abi", turns, moment).reshape(-1, 3)[upward]
        self.stretch_m = float(np.linalg.norm(self.wrist_m, axis=1).max())
        self.reached_m = np.linalg.norm(self.wrist_m[:, :2], axis=1) + np.abs(self.origin_m[:2]).sum()
        self.lower_m = float(np.linalg.norm(state.joint_origin_m[0, 3] - state.joint_origin_m[0, 2]))
        self.farthest_m = float(np.linalg.norm(self.origin_m)) + self.stretch_m + self.above_m

    def spans(
        self, tilt: float, height_m: tuple[float, float], follow_kg: float, over_m: float | None = None
    ) -> tuple[Array, Array]:
        """Bounds (2, 3) of the wrist at heights over the body's origin, and of the moment less so much of the wrist.

        What a tilt does counts for `over_m` of the height only, where the rest of it is counted elsewhere.
        """
        rounding = _FINE_RAD / 2 * (self.stretch_m + self.lower_m)
        up = self.wrist_m[:, 2] + self.origin_m[2]
        more = 2**0.5 * np.sin(tilt) * self.reached_m.max() + np.sin(tilt) ** 2 * np.abs(up[[0, -1]]).max() + rounding
        near = slice(*np.searchsorted(up, [height_m[0] - more - 1e-9, height_m[1] + more + 1e-9]))
        up = up[near]
        slack = rounding + 2**0.5 * np.sin(tilt) * self.reached_m[near] + np.sin(tilt) ** 2 * np.abs(up)
        kept = (up + slack >= height_m[0]) & (up - slack <= height_m[1])
        wrists = self.wrist_m[near][kept]
        level = self._turned(wrists, rounding) + self.origin_m
        far, s, c = np.abs(level).max(axis=0), np.sin(tilt), np.cos(tilt)
        over = float(np.abs(height_m).max()) if over_m is None else over_m
        along = ((1.0 - c) * far[0] + s * over) / c
        across = ((1.0 - c) * far[1] + s * (s * (far[0] + along) + over)) / c
        wrist = level + np.outer([-1.0, 1.0], [along, across, 0.0])
        wrist[:, 2] = height_m
        less = self.moment[near][kept] - follow_kg * wrists
        moment = self._turned(less, (self.mass_kg + follow_kg) * rounding)
        moment = _tilted(moment + (self.mass_kg - follow_kg) * self.origin_m, tilt)
        side = float(np.hypot(self.hand[0], self.hand[1]))
        return wrist, moment + np.array([[-side, -side, self.hand[2]], [side, side, self.hand[2]]])

    def _turned(self, vectors: Array, rounding: float) -> Array:
        """Bounds (2, 3) of vectors (n, 3) turned by the first joint."""
        size, ends = np.hypot(vectors[:, 0], vectors[:, 1]), []
        for axis in (0.0, np.pi / 2):
            ends.append((-self._along(axis - np.pi, vectors, size), self._along(axis, vectors, size)))
        ends.append((vectors[:, 2].min(), vectors[:, 2].max()))
        return np.asarray(np.array(ends).T + np.outer([-rounding, rounding], np.ones(3)))

    def _along(self, axis: float, vectors: Array, size: Array) -> float:
        """How far vectors of such sizes along x and y, turned by the first joint, come along an axis at an angle."""

        def most(some: Array, sizes: Array) -> float:
            way = np.arctan2(some[:, 1], some[:, 0]) - axis
            return float((sizes * _most_cos(way + self.limb.lower_rad[0], way + self.limb.upper_rad[0])).max())

        longest = slice(at := int(np.argmax(size)), at + 1)
        may = size >= most(vectors[longest], size[longest])  # none comes farther than it is long
        return most(vectors[may], size[may])


@lru_cache(maxsize=4)
def _arm(limb: Limb) -> _Arm:
    return _Arm(limb)


@lru_cache(maxsize=32)
def _spans(
    arm: _Arm, tilt: float, height_m: tuple[float, float], follow_kg: float, over_m: float | None
) -> tuple[Array, Array]:
    return arm.spans(tilt, height_m, follow_kg, over_m)


def _turns(axis: Array, angles: Array) -> Array:
    """Rotations (n, 3, 3) about a unit vector."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + s * skew + (1.0 - c) * (skew @ skew))


def _most_cos(first: Array, last: Array) -> Array:
    """The largest cosine between two angles, the second the larger."""
    whole = np.ceil(first / (2 * np.pi)) * 2 * np.pi <= last
    return np.asarray(np.where(whole, 1.0, np.maximum(np.cos(first), np.cos(last))))


def _tilted(ends: Array, tilt: float) -> Array:
    """Bounds (2, 3) along a heading's axes of a vector within bounds along the body's."""
    x, y, z = np.abs(ends).max(axis=0)
    s, bent = np.sin(tilt), np.sin(tilt) ** 2
    return np.asarray(
        ends + np.outer([-1.0, 1.0], [bent * x + s * (s * y + z), bent * y + s * z, s * (x + y) + bent * z])
    )
