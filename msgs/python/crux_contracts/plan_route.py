"""A route in parts: a folder of plan files 00000.mcap, 00001.mcap, ..., each from the stance in which the one before
ends. A part is there as soon as its file is; the folder tells no more.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from crux_msgs import hold_t, plan_t

from . import LIMB_NAMES
from .plan_file import PlanFileError, plan_id, read_plan

TOLERANCE = 1e-6  # between the end of a part and the start of the next: m, rad


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
    for name in ("robot_sha256", "patch_k_m", "max_normal_n"):
        old, new = getattr(before, name), getattr(part, name)
        if old != new:
            return f"{name} is {new}, expected {old}"
    if max(abs(a - b) for a, b in zip(before.gravity_w_m_s2, part.gravity_w_m_s2, strict=True)) > TOLERANCE:
        return "another gravity"
    end, begin = before.knots[-1], part.knots[0]
    for name in ("body_position_w_m", "body_rpy_rad"):
        if (off := _off(getattr(end, name), getattr(begin, name))) > TOLERANCE:
            return f"the body begins {off:.3g} off in {name}"
    for limb, held, holds in zip(LIMB_NAMES, end.limbs, begin.limbs, strict=True):
        off = _off(
            [*held.gripper_position_w_m, held.gripper_yaw_w_rad], [*holds.gripper_position_w_m, holds.gripper_yaw_w_rad]
        )
        if off > TOLERANCE or held.phase != holds.phase:
            return f"{limb} begins {off:.3g} m or rad off, phase {holds.phase}, expected {held.phase}"
    return ""


def _off(one: list[float], other: list[float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def joined(before: plan_t, part: plan_t) -> plan_t:
    """Both as one plan, as the runtime joins them: the knots of `before` less its last one, then those of `part`, whose
    scenario has the goal.
    """
    whole = plan_t.decode(part.encode())
    whole.cost = before.cost + part.cost
    numbers = {_of(hold): i for i, hold in enumerate(before.holds)}
    whole.holds = list(before.holds)
    for hold in part.holds:
        if _of(hold) not in numbers:
            numbers[_of(hold)] = len(whole.holds)
            whole.holds.append(hold)
    for knot in whole.knots:
        knot.time_s += before.knots[-1].time_s
        for limb in knot.limbs:
            limb.hold = numbers[_of(part.holds[limb.hold])] if limb.hold >= 0 else limb.hold
    whole.knots = [*before.knots[:-1], *whole.knots]
    whole.n_knots, whole.n_holds = len(whole.knots), len(whole.holds)
    whole.plan_id = plan_id(whole)
    return whole


def _of(hold: hold_t) -> tuple[str, tuple[float, ...]]:
    """What tells holds of one wall apart."""
    return hold.name, tuple(hold.position_w_m)
