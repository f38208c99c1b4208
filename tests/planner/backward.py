"""Walls built backwards from a motion: holds are put where the limbs of a robot that climbs happen to be.

A motion is drawn at random: body poses within (7), limbs that swing or stay, grasps in reach by numeric inverse
kinematics within the joint limits, links off the trunk and one another by Coal. Faces get friction and spines at
random. It counts where wrenches at every knot balance the true centre of mass as it accelerates, within an inscribed
polytope of the limit surface. Such a wall has a plan as far as proofs and bounds know, and its cheapest one costs no
more than the motion.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.cost_weights import CLIMB
from crux_contracts.robot import Robot, load_robot
from crux_planner.checker.geometry import Array, Flags, Indices, body_rate_matrix, rotation_about_z, rotation_from_rpy
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import ChainState, load_model
from crux_planner.solvers.qp import Qp
from reach.pinocchio_limb import PinocchioLimb

ROBOT = load_robot("scaler")
DT_S, PAD_M, SIZE_M, TALL_M = 2.0, 0.035, 0.06, 0.06
PATCH_M, SPINE_N, SPINE_NM, NORMAL_N = 0.02, 5.0, 0.05, 60.0
K_M = PATCH_M * 2 / 3
AIR_KNOTS, AIR_M, OPENING_M = 8, 0.1, 0.048
SPACING_M, APART_M = 0.17, 0.003
SHOULDERS = np.array([[0.1355, 0.144], [0.1355, -0.144], [-0.1355, 0.144], [-0.1355, -0.144]])
FEET = np.array([[0.14, 0.36], [0.14, -0.36], [-0.14, 0.36], [-0.14, -0.36]])


@dataclass(frozen=True)
class Backward:
    """A wall, its motion's J (6) for so many steps, and whether all grasps are in the middle of their faces."""

    wall: dict[str, Any]
    cost: float
    centred: bool


def backward_wall(seed: int) -> Backward | None:
    """None where the motion drawn is none."""
    random, robot = np.random.default_rng(seed), ROBOT
    steps, centred = int(random.integers(12, 19)), bool(random.random() < 0.5)
    poses = _poses(random, steps, robot)
    first = random.integers(1, steps - AIR_KNOTS, 4)  # knot in the air
    swings = random.random(4) < random.choice([0.3, 0.6])
    drawn = (_holds(random, poses, swings, first) for _ in range(100))
    ends = next((each for each in drawn if each is not None), None)
    if ends is None:
        return None
    holds = np.concatenate([ends[0], ends[1][swings]])
    knot = np.arange(steps + 1)[:, None]
    air = swings & (knot >= first) & (knot < first + AIR_KNOTS)
    after = swings & (knot >= first + AIR_KNOTS)
    share = np.where(swings, np.clip((knot - first) / AIR_KNOTS, 0.0, 1.0), 0.0)[..., None]
    hands = (1 - share) * ends[0] + share * ends[1]
    hands[..., 2] = np.where(air & (knot > first), AIR_M, PAD_M)
    states = _states(poses, hands, robot)
    if states is None:
        return None
    limit = np.array([_limits(random) for _ in holds])  # (h, 2, 4): friction and three spines of each finger
    slope = float(180.0 * random.random() ** 1.5)
    which = np.where(after, np.cumsum(swings) + 3, np.arange(4))
    forces = _wrenches(poses, hands, air, limit[which], states, slope, robot)
    if forces is None:
        return None
    wall = _wall(holds, limit, swings, slope, poses, random, centred)
    return Backward(wall, _cost(poses, air, hands, forces), centred)


def _poses(random: np.random.Generator, steps: int, robot: Robot) -> Array:
    """(N + 1, 6), at rest at both ends."""
    t = np.clip((np.arange(steps + 1) - 1) / (steps - 2), 0.0, 1.0)
    way = random.uniform(-1.0, 1.0, 6) * DT_S * (steps - 2) / 1.6 * 0.02 * random.random()
    way[3:5] = np.clip(way[3:5], -0.05, 0.05)
    begin = np.array([0.0, 0.0, random.uniform(0.175, 0.2), *random.uniform(-0.05, 0.05, 2), random.uniform(-2.5, 2.5)])
    way[2] = np.clip(way[2], robot.body.height_m[0] - begin[2], robot.body.height_m[1] - begin[2])
    return np.round(begin, 4) + (t * t * (3 - 2 * t))[:, None] * np.round(way, 4)


def _holds(random: np.random.Generator, poses: Array, swings: Flags, first: Indices) -> Array | None:
    """(2, 4, 4): x, y, z, yaw of grippers at the start and at the end, None where limbs hardly reach so far."""
    ends = []
    for pose in (poses[0], poses[-1]):
        off = FEET + random.uniform(-1.0, 1.0, (4, 2)) * [0.13, 0.09]
        turn, yaw = rotation_about_z(pose[5])[:2, :2], pose[5] + random.uniform(-0.5, 0.5, 4)
        ends.append(np.round(np.column_stack([pose[:2] + off @ turn.T, np.full(4, PAD_M), yaw]), 4))
    ends[1] = np.where(swings[:, None], ends[1], ends[0])
    last = np.where(swings, first + AIR_KNOTS, 0)
    bodies = poses[np.array([[0 * first, first], [last, 0 * first - 1]])]  # (2, 2, 4, 6): when limbs are on each
    x, y = np.moveaxis(np.array(ends)[:, None, :, :2] - bodies[..., :2], -1, 0)
    c, s = np.cos(bodies[..., 5]), np.sin(bodies[..., 5])
    far = np.hypot(c * x + s * y - SHOULDERS[:, 0], c * y - s * x - SHOULDERS[:, 1])
    if far.max() > 0.335 or far.min() < 0.1:
        return None
    holds = np.concatenate([ends[0], ends[1][swings]])[:, :2]
    apart = np.linalg.norm(holds[:, None] - holds, axis=2) + np.eye(len(holds))
    return np.array(ends) if apart.min() >= SPACING_M else None


def _states(poses: Array, hands: Array, robot: Robot) -> list[ChainState] | None:
    model, turn, many = load_model(robot), rotation_from_rpy(poses[:, 3:]), len(poses)
    places = [np.einsum("kji,kj->ki", turn, hands[:, i, :3] - poses[:, :3]) for i in range(4)]
    upright = [np.einsum("kji,kjl->kil", turn, rotation_about_z(hands[:, i, 3])) for i in range(4)]
    states, solved = [], solve(model.limbs, places, upright)
    for limb, found in zip(model.limbs, solved, strict=True):
        inside = (found.q_rad >= limb.lower_rad).all() and (found.q_rad <= limb.upper_rad).all()
        if not inside or found.position_error_m.max() > 1e-6 or found.rotation_error_rad.max() > 1e-6:
            return None
        states.append(limb.forward(found.q_rad, np.full(many, SIZE_M / 2)))
    return states if all(_clear(q_rad) for q_rad in zip(*(found.q_rad for found in solved), strict=True)) else None


@lru_cache
def _limbs() -> list[PinocchioLimb]:
    return [PinocchioLimb(ROBOT, limb) for limb in range(len(LIMB_NAMES))]


def _clear(q_rad: Sequence[Array]) -> bool:
    """Whether links keep off the trunk and those of other limbs."""
    posed = list(zip(_limbs(), q_rad, strict=True))
    return all(limb.off_trunk_m(q) >= 0.0 for limb, q in posed) and all(
        one.apart_m(q, other, other_q) >= APART_M for (one, q), (other, other_q) in itertools.combinations(posed, 2)
    )


def _limits(random: np.random.Generator) -> Array:
    """(2, 4): friction and most of the spines in (s1, s2, m / k) of the faces +x and -x."""
    friction = np.round(random.uniform(0.3, 2.5, 2), 2)
    spines = (random.random(2) < 0.7)[:, None] * [SPINE_N, SPINE_N, SPINE_NM / K_M]
    return np.column_stack([friction, spines])


def _wrenches(
    poses: Array, hands: Array, air: Array, limits: Array, states: list[ChainState], slope: float, robot: Robot
) -> Array | None:
    """Least |q|^2 of all grips (N,) at every knot, in (6); None where some knot lacks balance."""
    model, turn = load_model(robot), rotation_from_rpy(poses[:, 3:])
    gravity = 9.81 * np.array([-np.sin(np.radians(slope)), 0.0, -np.cos(np.radians(slope))])
    centre = poses[:, :3] + np.einsum("kij,kj->ki", turn, model.centre_of_mass(states))
    inertia, rates = model.inertia(states, 0), _rates(poses)
    speed = np.append(np.diff(poses[:, :3], axis=0) / DT_S, np.zeros((1, 3)), axis=0)
    found = np.zeros(len(poses) - 1)
    for k in np.argsort(-air[:-1].sum(axis=1), kind="stable"):  # what may lack balance first
        force = model.mass_kg * ((speed[k + 1] - speed[k]) / DT_S - gravity)
        spin = inertia @ (rates[k + 1] - rates[k]) / DT_S + np.cross(rates[k], inertia @ rates[k])
        target = np.concatenate([force, turn[k] @ spin + np.cross(centre[k], force)])
        on = np.flatnonzero(~air[k])
        least = _least(hands[k, on], limits[k, on], target) if on.size else None
        if least is None:
            return None
        found[k] = least
    return found


def _rates(poses: Array) -> Array:
    turning = np.append(np.diff(poses[:, 3:], axis=0) / DT_S, np.zeros((1, 3)), axis=0)
    return np.asarray(np.einsum("kij,kj->ki", body_rate_matrix(poses[:, 3:]), turning))


@lru_cache
def _ball() -> Array:
    """Directions d whose polytope {d . x <= 1} lies in the unit ball."""
    ends = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    ends = ends[np.abs(ends).sum(axis=1) > 0]
    ends = ends / np.linalg.norm(ends, axis=1)[:, None]
    some = np.random.default_rng(0).normal(size=(20_000, 3))
    some /= np.linalg.norm(some, axis=1)[:, None]
    return np.asarray(ends / ((some @ ends.T).max(axis=1).min() - 0.01))


def _least(hands: Array, limits: Array, target: Array) -> float | None:
    """Variables of a grip: (s1, s2, m / k, n1, n2) and, of both fingers, what of the load the spines bear."""
    many, ball = len(hands), _ball()
    n = 11 * many
    square, equal = np.zeros(n), np.zeros((6, n))
    low, high, rows = np.full(n, -300.0), np.full(n, 300.0), []
    for i, (hand, limit) in enumerate(zip(hands, limits, strict=True)):
        at, (c, s) = 11 * i, (np.cos(hand[3]), np.sin(hand[3]))
        axis, tangent, up = np.array([c, s, 0.0]), np.array([-s, c, 0.0]), np.array([0.0, 0.0, 1.0])
        square[at : at + 5] = 2, 2, 2, 1, 1
        force = np.column_stack([2 * tangent, 2 * up, np.zeros(3), axis, -axis])
        equal[:3, at : at + 5] = force
        equal[3:, at : at + 5] = np.cross(hand[:3], force, axisb=0, axisc=0)
        equal[3:, at + 2] += 2 * K_M * axis
        low[at + 3 : at + 5], high[at + 3 : at + 5] = 0.0, NORMAL_N
        for finger in (0, 1):
            part = np.zeros((len(ball), n))
            mine = slice(at + 5 + 3 * finger, at + 8 + 3 * finger)
            part[:, at : at + 3], part[:, mine] = ball, -ball
            part[:, at + 3 + finger] = -limit[finger, 0]
            low[mine], high[mine] = -limit[finger, 1:], limit[finger, 1:]
            rows.append(part)
    below = np.vstack(rows)
    qp = Qp(np.diag(2 * square + 1e-7), np.zeros(n), (equal, target), (below, None, np.zeros(len(below))), low, high)
    found = qp.solve()
    if not found.solved or np.abs(equal @ found.x - target).max() > 1e-4:
        return None
    return float(square @ found.x**2)


def _wall(
    holds: Array, limits: Array, swings: Array, slope: float, poses: Array, random: np.random.Generator, centred: bool
) -> dict[str, Any]:
    wide = SIZE_M if centred else 0.09
    parts, names = [], [*LIMB_NAMES, *(f"{LIMB_NAMES[i]}-next" for i in np.flatnonzero(swings))]
    for name, (x, y, _, yaw), limit in zip(names, holds, limits, strict=True):
        aside = 0.0 if centred else random.uniform(-1, 1) * (wide / 2 - PATCH_M)
        place = [float(x + aside * np.sin(yaw)), float(y - aside * np.cos(yaw))]
        friction = {"+x": float(limit[0, 0]), "-x": float(limit[1, 0]), "+y": 0.0, "-y": 0.0, "top": 0.0}
        spines = {"+x": bool(limit[0, 1]), "-x": bool(limit[1, 1])}
        size = [SIZE_M, wide, TALL_M]
        yaw_deg = float(np.degrees(yaw))
        parts.append(
            {
                "name": name,
                "position_m": place,
                "size_m": size,
                "yaw_deg": yaw_deg,
                "friction": friction,
                "spines": spines,
            }
        )
    grasps = {limb: {"hold": limb, "faces": "x"} for limb in LIMB_NAMES}
    body = [{"position_m": p[:3].tolist(), "rpy_deg": np.degrees(p[3:]).tolist()} for p in (poses[0], poses[-1])]
    goal: dict[str, Any] = {"body": {**body[1], "tolerance_m": 0.001, "tolerance_deg": 0.1}}
    if random.random() < 0.5:
        goal["grasps"] = {
            limb: {"hold": f"{limb}-next" if on else limb, "faces": "x"}
            for limb, on in zip(LIMB_NAMES, swings, strict=True)
        }
    return {
        "version": 1,
        "name": "backwards",
        "robot": "scaler",
        "wall": {"slope_deg": slope},
        "contact": {
            "model": "patch", "patch_radius_m": PATCH_M, "max_normal_N": NORMAL_N,
            "spine_shear_N": SPINE_N, "spine_twist_Nm": SPINE_NM,
        },
        "holds": parts,
        "start": {"body": body[0], "grasps": grasps},
        "goal": goal,
        "horizon": {"steps": len(poses) - 1, "dt_s": DT_S},
    }  # fmt: skip


def _cost(poses: Array, air: Array, hands: Array, forces: Array) -> float:
    """J (6) with the usual weights."""
    w, goal = CLIMB, poses[-1]
    speed = np.append(np.diff(poses[:, :3], axis=0) / DT_S, np.zeros((1, 3)), axis=0)
    total = w.position * ((poses[:, :3] - goal[:3]) ** 2).sum() + w.orientation * ((poses[:, 3:] - goal[3:]) ** 2).sum()
    total += w.velocity * ((speed**2).sum() + (_rates(poses) ** 2).sum()) + w.wrench * forces.sum()
    total -= w.lift * hands[..., 2][air].sum() + w.opening * 2 * OPENING_M * air.sum()
    return float(total + w.switching * np.abs(np.diff(air.astype(int), axis=0)).sum())
