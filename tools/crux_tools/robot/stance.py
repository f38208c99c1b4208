"""Where a robot's grippers reach the wall, and a stance in the middle of that: any chains, by the checker's kinematics.

The body is level, at the middle of its heights; the body frame's x goes up the wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from crux_contracts.robot_bounds import JOINTS
from crux_planner.checker import geometry
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import ChainState, Limb, Link, WholeRobot
from crux_planner.checker.parts import Part, shapes
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEP_M = 0.04
YAWS = 5  # over the range of grasp.gripper_yaw_rad
MARGIN_RAD = 0.05  # to joint limits
CLEAR_M = 0.003  # of links
AHEAD_M = (0.0, 0.04, 0.08, 0.12)  # of a stance's grippers, off the middle of their reach
FOUND_M, FOUND_RAD = 1e-4, 1e-3  # of a solution from the pose


def shoulder_m(limb: Limb) -> Array:
    """(3,) where the first joint is that turns, in the body frame."""
    return np.asarray(limb.forward(np.zeros((1, len(limb.joints)))).joint_origin_m[0, 0])


@dataclass(frozen=True)
class LimbReach:
    """Places (m, 2) on the wall that a limb reaches, its links CLEAR_M off the body, and joint angles (m, J) there, at
    the yaw at which it reaches most of them.
    """

    limb: Limb
    yaw_rad: float
    height_m: float
    places_m: Array
    q_rad: Array

    @property
    def area_m2(self) -> float:
        return len(self.places_m) * STEP_M**2

    def nearest(self, ahead_m: float = 0.0) -> int:
        """Of the places the one nearest to their mean, or to what is so far off it, front limbs up, rear limbs down."""
        ahead = np.array([np.copysign(ahead_m, shoulder_m(self.limb)[0]), 0.0])
        return int(np.linalg.norm(self.places_m - self.places_m.mean(axis=0) - ahead, axis=1).argmin())


def limb_reach(body: Link, limb: Limb, sections: dict[str, Any]) -> LimbReach:
    """Of an upright gripper, opened for a swing, at the middle of its heights."""
    (low, high), (pad_low, pad_high) = sections["body"].height_m, sections["grasp"].pad_height_m
    height = (pad_low + pad_high) / 2 - (low + high) / 2
    first_turns = [joint.kind for joint in limb.chain].index("revolute")  # it may hang on fixed joints
    span = float(sum(np.linalg.norm(joint.origin_m) for joint in limb.chain[first_turns + 1 :]))
    shoulder = shoulder_m(limb)
    outward = 1.0 if shoulder[1] >= 0 else -1.0
    x = shoulder[0] + np.arange(-span, span + STEP_M, STEP_M)
    first = abs(shoulder[1]) % STEP_M if len(limb.joints) < JOINTS else 0.0  # such a limb may reach ahead of it alone
    y = outward * np.arange(first, abs(shoulder[1]) + span + STEP_M, STEP_M)
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    grid[1::2] = grid[1::2, ::-1]  # to and fro: each place is near the one before, from whose posture it is found
    flat = grid.reshape(-1, 2)
    places = np.column_stack([flat, np.full(len(flat), height)])
    places = places[np.linalg.norm(places - shoulder, axis=1) <= span]
    middle = np.linalg.norm(places - shoulder - [0.0, outward * span / 2, 0.0], axis=1).argmin()
    places = np.roll(places, -int(middle), axis=0)
    found = []
    least, most = sections["grasp"].gripper_yaw_rad
    for yaw in np.linspace(least, most, YAWS):
        turn = np.broadcast_to(geometry.rotation_about_z(np.array([yaw])), (len(places), 3, 3))
        (solution,) = solve([limb], [places], [turn])
        good = (solution.position_error_m < FOUND_M) & (solution.rotation_error_rad < FOUND_RAD)
        inside = (solution.q_rad >= limb.lower_rad + MARGIN_RAD) & (solution.q_rad <= limb.upper_rad - MARGIN_RAD)
        good &= inside.all(axis=1)
        if limb.actuators is not None:
            good &= limb.actuators.keeps(solution.q_rad)
        good[good] = _clearance(body, limb, solution.q_rad[good], sections["gripper"].open_opening_m) >= CLEAR_M
        found.append(LimbReach(limb, float(yaw), height, places[good, :2], solution.q_rad[good]))
    return max(found, key=lambda each: len(each.places_m))


def _clearance(body: Link, limb: Limb, q_rad: Array, opening_m: float) -> Array:
    """(n,) [m] of a limb's links and the body at joint angles (n, J)."""
    parts = _off_body(limb, _parts(list(limb.links), limb.forward(q_rad, np.full(len(q_rad), opening_m))))
    gaps = [_gaps(one, other) for _, one in parts for _, other in _parts([body], None)]
    return np.min(gaps, axis=0) if gaps else np.full(len(q_rad), np.inf)


@dataclass(frozen=True)
class Stance:
    """A robot with its grippers on holds, turned as they are: each limb's angles (J,) and links, body frame."""

    model: WholeRobot
    q_rad: list[Array]
    states: list[ChainState]

    def gripper(self, limb: int) -> tuple[Array, Array]:
        """Place (3,) [m] and rotation (3, 3) of the gripper of limb number `limb`, body frame."""
        state, link = self.states[limb], self.model.limbs[limb].gripper
        return state.link_position_m[link][0], state.link_rotation[link][0]


def stance(model: WholeRobot, reaches: list[LimbReach], opening_m: float) -> Stance:
    """Every gripper in the middle of what its limb reaches, or the least of AHEAD_M off it with which all keep off each
    other, else the farthest; all limbs must reach something.
    """
    for ahead_m in AHEAD_M:
        found = standing(model, [each.q_rad[each.nearest(ahead_m)] for each in reaches], opening_m)
        if closest(found)[0] >= CLEAR_M:
            break
    return found


def standing(model: WholeRobot, q_rad: list[Array], opening_m: float) -> Stance:
    """At joint angles (J,) a limb."""
    opening = np.array([opening_m])
    states = [limb.forward(q[None], opening) for limb, q in zip(model.limbs, q_rad, strict=True)]
    return Stance(model, q_rad, states)


def closest(stance: Stance) -> tuple[float, str]:
    """The least clearance [m] between limbs, and between limbs and the body, negative where they overlap."""
    found = ((float(_gaps(a, b)[0]), name) for name, one, other in _sides(stance) for _, a in one for _, b in other)
    return min(found, default=(np.inf, ""))


@dataclass(frozen=True)
class Meeting:
    """Two links, and the clearance [m] between them, negative where they overlap."""

    links: tuple[str, str]
    gap_m: float


def meetings(stance: Stance, clear_m: float) -> list[Meeting]:
    """Links of two limbs, or of a limb and the body, with less than this clearance; the closest ones first."""
    found: dict[tuple[str, str], float] = {}
    for _, one, other in _sides(stance):
        (low, high), (their_low, their_high) = (
            np.array([part.corners for _, part in side])[..., 0].reshape(-1, 2, 3).swapaxes(0, 1)
            for side in (one, other)
        )
        apart = np.maximum(low[:, None] - their_high, their_low - high[:, None]).max(axis=2)
        for i, j in zip(*np.nonzero(apart < clear_m), strict=True):
            links, gap = (one[i][0], other[j][0]), float(_gaps(one[i][1], other[j][1])[0])
            if gap < min(clear_m, found.get(links, np.inf)):
                found[links] = gap
    return [Meeting(links, gap) for links, gap in sorted(found.items(), key=lambda each: each[1])]


_Placed = list[tuple[str, Part]]  # shapes, with the names of their links


def _sides(stance: Stance) -> list[tuple[str, _Placed, _Placed]]:
    """All that is to keep off each other: every two limbs, and limbs and the body but for what turns on it."""
    body, limbs = _parts([stance.model.body], None), stance.model.limbs
    parts = [_parts(list(limb.links), state) for limb, state in zip(limbs, stance.states, strict=True)]
    sides = [(f"{limbs[i].name} to {limbs[j].name}", parts[i], parts[j]) for i, j in combinations(range(len(limbs)), 2)]
    for limb, its in zip(limbs, parts, strict=True):
        sides.append((f"{limb.name} to the body", _off_body(limb, its), body))
    return [side for side in sides if side[1] and side[2]]


def _off_body(limb: Limb, parts: _Placed) -> _Placed:
    """Those of a limb that are to keep off the body."""
    return [each for each in parts if each[0] not in limb.on_body]


def _parts(links: list[Link], state: ChainState | None) -> _Placed:
    found = []
    for link in links:
        place = np.zeros((1, 3)) if state is None else state.link_position_m[link.name]
        turn = np.eye(3)[None] if state is None else state.link_rotation[link.name]
        found += [(link.name, part) for part in shapes("link", link, place, turn)]
    return found


def _gaps(a: Part, b: Part) -> Array:
    """Clearance (n,) of two parts at n samples, or one, negative where they overlap."""
    if a.half_m is None and b.half_m is not None:
        a, b = b, a
    if a.half_m is None or a.rotation is None:
        return geometry.segment_to_segment(a.start, a.end, b.start, b.end) - a.radius_m - b.radius_m
    start, end = (geometry.turned_back(a.rotation, at - a.start) for at in (b.start, b.end))
    if b.half_m is None or b.rotation is None:
        return geometry.segment_to_box(start, end, a.half_m) - b.radius_m
    return geometry.box_to_box(start, a.rotation.swapaxes(1, 2) @ b.rotation, b.half_m, a.half_m)
