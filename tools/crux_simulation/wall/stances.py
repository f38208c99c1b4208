"""Where a level body stands on four of the holds: by the checker's inverse kinematics, on a grid over the wall."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.gripper_frames import yaw_and_tilt
from crux_contracts.robot import Robot
from crux_planner import Faces
from crux_planner.checker.geometry import rotation_about_z
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_tools.robot.stance import limb_reach

from crux_simulation.wall.box import Box
from crux_simulation.wall.surface import Array

STEP_M = 0.05
MARGIN_RAD = 0.05
FOUND_M, FOUND_RAD = 1e-4, 1e-3
MOST_POSES = 20_000  # of a limb; on larger walls the grid is coarser
STARTS = 12  # and goals, that are tried, no two with the same grasps


@dataclass(frozen=True)
class Stance:
    """A body's place (x, y, height) [m], by limb the hold and its pair of faces, and how far [m] the grippers are from
    the middles of what their limbs reach, in the sum.
    """

    body_m: tuple[float, float, float]
    grasps: dict[str, tuple[str, str]]
    off_m: float


def stances(holds: list[Box], robot: Robot) -> list[Stance]:
    """Of each place of the body on a grid the stance whose grippers are nearest to the middles of the limbs' reach."""
    grips = _grips(holds, robot)
    if len(holds) < len(LIMB_NAMES):
        return []
    model, height = load_model(robot), sum(robot.body.height_m) / 2.0
    foot = np.array([hold.foot_m[:2] for hold in holds])
    low, high = foot.min(axis=0), foot.max(axis=0)
    step = max(STEP_M, float(np.sqrt(np.prod(high - low + STEP_M) * len(grips) / MOST_POSES)))
    x, y = (np.linspace(a, b, 2 + int((b - a) / step)) for a, b in zip(low, high, strict=True))
    bodies = np.array([[i, j, height] for j in y for i in x])
    places, rotations = (np.array([grip[i] for grip in grips]) for i in (2, 3))
    wanted = places[None] - bodies[:, None]
    turns = np.broadcast_to(rotations, (len(bodies), len(grips), 3, 3))
    off = np.full((len(model.limbs), len(bodies), len(grips)), np.inf)
    sections = {"body": robot.body, "grasp": robot.grasp, "gripper": robot.gripper}
    for mine, limb in zip(off, model.limbs, strict=True):
        middle = limb_reach(model.body, limb, sections).places_m.mean(axis=0)
        away = np.linalg.norm(wanted[..., :2] - middle, axis=2)
        near = away < sum(float(np.linalg.norm(joint.origin_m)) for joint in limb.chain[1:])
        (found,) = solve([limb], [wanted[near]], [turns[near]])
        good = (found.position_error_m < FOUND_M) & (found.rotation_error_rad < FOUND_RAD)
        good &= ((found.q_rad >= limb.lower_rad + MARGIN_RAD) & (found.q_rad <= limb.upper_rad - MARGIN_RAD)).all(
            axis=1
        )
        mine[near] = np.where(good, away[near], np.inf)
    best = (_best(body, off[:, i], grips) for i, body in enumerate(bodies))
    return [stance for stance in best if stance is not None]


def ends(found: list[Stance], refusal: Callable[[Stance], str]) -> tuple[Stance, Stance] | str:
    """A start in the lowest quarter of the wall and a goal in the highest, or the one below, for which `refusal` is
    empty; else what there is none for.
    """
    if not found:
        return "no level body has four holds in reach"
    heights = np.array([stance.body_m[0] for stance in found])
    share = (heights - heights.min()) / max(float(np.ptp(heights)), 1e-9)
    chosen = []
    for end, quarters in (("a start", [share <= 0.25]), ("a goal", [share >= 0.75, (share >= 0.5) & (share < 0.75)])):
        tried: dict[frozenset[tuple[str, tuple[str, str]]], str] = {}  # by grasps, why not
        order = [i for within in quarters for i in sorted(np.flatnonzero(within), key=lambda i: found[i].off_m)]
        for stance in (found[i] for i in order):
            grasps = frozenset(stance.grasps.items())
            if grasps in tried or len(tried) == STARTS:
                continue
            tried[grasps] = refusal(stance)
            if not tried[grasps]:
                chosen.append(stance)
                break
        else:
            places = f"a level body has four holds in reach at {len(found)} places"
            return f"{places}, but none of the {len(tried)} tried can be {end}; the first: {next(iter(tried.values()))}"
    return chosen[0], chosen[1]


Grip = tuple[str, str, Array, Array]  # hold, faces, place of the gripper's middle (3,) and rotation (3, 3) in W


def _grips(holds: list[Box], robot: Robot) -> list[Grip]:
    """All ways to grip the holds, turned as the robot's grippers may be."""
    low, high = robot.grasp.gripper_yaw_rad
    found: list[Grip] = []
    for hold in holds:
        upright = yaw_and_tilt(hold.rotation)[0]
        for faces, turn, can in (("x", 0.0, hold.faces[0]), ("y", np.pi / 2.0, hold.faces[1])):
            place = _place(hold, "xy".index(faces), robot) if can else None
            for half in (-np.pi, 0.0, np.pi):
                if place is not None and low <= upright + turn + half <= high:
                    rotation = hold.rotation @ rotation_about_z(np.array(turn + half))
                    found.append((hold.name, faces, place, rotation))
    return found


def _place(hold: Box, pair: int, robot: Robot) -> Array | None:
    """Where a gripper's middle is on a pair of faces in W, as the planner has it."""
    as_hold = hold.as_hold
    grip = next(iter(as_hold.places("xy"[pair])), None)
    faces = Faces.of(as_hold, pair, robot, robot.gripper.pad_radius_m, grip)
    if faces is None:
        return None
    yaw = hold.yaw_rad + pair * np.pi / 2.0
    off = faces.off_m * np.array([np.cos(yaw), np.sin(yaw)]) + faces.aside_m * np.array([-np.sin(yaw), np.cos(yaw)])
    return hold.frame.in_w(np.array([*(hold.position_m + off), faces.height_m]))


def _best(body: Array, off_m: Array, grips: list[Grip]) -> Stance | None:
    """For every limb the nearest grip that no other has; None where a limb has none."""
    taken: dict[str, tuple[str, str]] = {}
    total, held = 0.0, set[str]()
    for name, mine in zip(LIMB_NAMES, off_m, strict=True):
        free = [k for k in np.argsort(mine, kind="stable") if np.isfinite(mine[k]) and grips[k][0] not in held]
        if not free:
            return None
        hold, faces = grips[free[0]][:2]
        taken[name], total = (hold, faces), total + float(mine[free[0]])
        held.add(hold)
    return Stance((float(body[0]), float(body[1]), float(body[2])), taken, total)
