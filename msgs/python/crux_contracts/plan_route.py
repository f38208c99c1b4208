"""A route in parts: a folder of plan files 00000.mcap, 00001.mcap, ..., each from the stance in which the one before
ends. A part is there as soon as its file is; the folder tells no more.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from crux_msgs import hold_t, limb_knot_t, plan_t

from . import LIMB_NAMES
from .plan_file import PlanFileError, plan_id, read_plan

TOLERANCE = 1e-6  # between the end of a part and the start of the next: m, rad
FOUND_M, FOUND_RAD = 0.05, 0.2  # from where a plan has a grip: one that is found farther off is another
_BODY = ("body_position_w_m", "body_rpy_rad")


def part_path(folder: Path, number: int) -> Path:
    """The file of a part, counted from 0."""
    return folder / f"{number:05d}.mcap"


def read_route(folder: Path) -> Iterator[tuple[Path, plan_t]]:
    """The parts that are there, in their order. Raises PlanFileError, also where a part does not begin where the one
    before ends.
    """
    before: plan_t | None = None
    number = 0
    while (path := part_path(folder, number)).exists():
        part = read_plan(path)
        if before is not None and (reason := misfit(before, part)):
            raise PlanFileError(f"{path}: does not go on from {part_path(folder, number - 1).name}: {reason}")
        yield path, part
        before, number = part, number + 1
    if before is None:
        raise PlanFileError(f"{folder}: no {part_path(folder, 0).name} in it, expected a route of crux plan --stream")


def misfit(before: plan_t, part: plan_t) -> str:
    """Why a plan cannot begin in the stance in which another one ends; empty where it can."""
    for name in ("format", "robot_sha256", "patch_k_m", "max_normal_n"):
        old, new = getattr(before, name), getattr(part, name)
        if old != new:
            return f"{name} is {new}, expected {old}"
    if max(abs(a - b) for a, b in zip(before.gravity_w_m_s2, part.gravity_w_m_s2, strict=True)) > TOLERANCE:
        return "another gravity"
    end, begin = before.knots[-1], part.knots[0]
    for name in _BODY:
        if (off := _off(getattr(end, name), getattr(begin, name))) > TOLERANCE:
            return f"the body begins {off:.3g} off in {name}"
    for limb, held, holds in zip(LIMB_NAMES, end.limbs, begin.limbs, strict=True):
        off = _off(_pose(held), _pose(holds))
        if off > TOLERANCE or held.phase != holds.phase:
            return f"{limb} begins {off:.3g} m or rad off, phase {holds.phase}, expected {held.phase}"
    return ""


def _pose(grip: limb_knot_t) -> list[float]:
    return [*grip.gripper_position_w_m, grip.gripper_yaw_w_rad, *grip.gripper_tilt_w_rad]


def _off(one: Sequence[float], other: Sequence[float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def join_knot(before: plan_t, part: plan_t) -> int:
    """The knot of `before` with which `part` begins: the last one with that body and all limbs on those holds, if grips
    may be where they were found instead. 0: none.
    """
    begin = part.knots[0]
    for k in range(len(before.knots) - 1, 0, -1):
        here = before.knots[k]
        if max(_off(getattr(here, name), getattr(begin, name)) for name in _BODY) <= TOLERANCE and all(
            _same_grip(before, held, part, holds) for held, holds in zip(here.limbs, begin.limbs, strict=True)
        ):
            return k
    return 0


def joined(before: plan_t, part: plan_t) -> plan_t:
    """Both as one plan, as the runtime joins them: the knots of `before` up to the one with which `part` begins, then
    those of `part`, whose scenario has the goal. Grips that `part` begins with are where it has them for as long as
    they last. Raises PlanFileError where `part` begins in no stance of `before`.
    """
    at = join_knot(before, part)
    if at == 0:
        raise PlanFileError("the part begins in no stance of the plan before it")
    before, whole = plan_t.decode(before.encode()), plan_t.decode(part.encode())
    whole.cost = before.cost + part.cost
    whole.holds = before.holds
    numbers = _with_holds(whole, part)
    for knot in whole.knots:
        knot.time_s += before.knots[at].time_s
        for limb in knot.limbs:
            limb.hold = numbers[limb.hold] if limb.hold >= 0 else limb.hold
    for number, found in enumerate(part.knots[0].limbs):
        for knot in reversed(before.knots[:at]):
            if knot.limbs[number].phase != limb_knot_t.STANCE:
                break
            _take_to(knot.limbs[number], found)
    whole.knots = [*before.knots[:at], *whole.knots]
    whole.n_knots, whole.n_holds = len(whole.knots), len(whole.holds)
    whole.plan_id = plan_id(whole)
    return whole


def _with_holds(whole: plan_t, part: plan_t) -> list[int]:
    """Numbers of the part's holds in the whole plan, in which they come to be where the part has them."""
    numbers = []
    for hold in part.holds:
        known = next((i for i, other in enumerate(whole.holds) if _same_hold(hold, other)), len(whole.holds))
        numbers.append(known)
        if known == len(whole.holds):
            whole.holds.append(hold)
        else:
            graspable = max(whole.holds[known].graspable, hold.graspable)
            whole.holds[known] = hold_t.decode(hold.encode())
            whole.holds[known].graspable = graspable
    return numbers


def _same_grip(before: plan_t, held: limb_knot_t, part: plan_t, holds: limb_knot_t) -> bool:
    return (
        held.phase == holds.phase == limb_knot_t.STANCE
        and held.finger1_face == holds.finger1_face
        and held.hold >= 0
        and holds.hold >= 0
        and _same_hold(before.holds[held.hold], part.holds[holds.hold])
        and _off(held.gripper_position_w_m, holds.gripper_position_w_m) <= FOUND_M
        and _off(_pose(held)[3:], _pose(holds)[3:]) <= FOUND_RAD
    )


def _same_hold(one: hold_t, other: hold_t) -> bool:
    """The same hold, wherever it was found."""
    return bool(one.name == other.name) and _off(one.position_w_m, other.position_w_m) <= FOUND_M


def _take_to(grip: limb_knot_t, found: limb_knot_t) -> None:
    """The grip is where `found` has it, and what its fingers bear turns with it."""
    turned_rad = found.gripper_yaw_w_rad - grip.gripper_yaw_w_rad
    if max(_off(grip.gripper_position_w_m, found.gripper_position_w_m), abs(turned_rad)) <= TOLERANCE:
        return
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    for name in ("finger_force_w_n", "finger_moment_w_nm"):
        v = list(getattr(grip, name))
        for i in (0, 3):
            v[i], v[i + 1] = c * v[i] - s * v[i + 1], s * v[i] + c * v[i + 1]
        setattr(grip, name, v)
    grip.gripper_position_w_m, grip.gripper_yaw_w_rad = list(found.gripper_position_w_m), found.gripper_yaw_w_rad
    grip.gripper_tilt_w_rad = list(found.gripper_tilt_w_rad)
