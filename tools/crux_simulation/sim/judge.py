"""Judges a climb on what happened in physics. What slip, lost grip, fall and goal are stands in tools/README.md.

The verdict needs no log. The log adds how well the runtime's own references were tracked, in the cycles that are in it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import PlanReference
from crux_contracts.plan_series import plan_series
from crux_msgs import limb_knot_t, robot_state_t
from crux_tools.robot3d.robot_model import RobotModel
from crux_tools.telemetry.rotations import angle_between, goal_pose, hold_rotation, rotations_from_quaternions
from numpy.typing import NDArray

from crux_simulation.sim.native import contact_period
from crux_simulation.sim.recorder import Truth
from crux_simulation.sim.reference_clock import LEAD_INTERVALS, ReferenceClock

SLIP_M = 0.005
WALK_SLIP_M = 0.010  # of a point foot: one that comes down late or early rubs a little
FALL_M = 0.100
OPENED_M, OPENS_S = 0.006, 1.0  # between the pads, and how soon after they have left a hold
LOST_HOLD_S = 0.1  # without contact in stance; shorter is chatter of one pad
UNLOADED_SHARE = 0.4  # of the contact force: below it a loaded pad counts as unloaded again
FULL_LOAD = 0.98  # share of the planned wrench from which on the wrench error counts
STANCE = 0  # LimbPhase
CLIMBING = robot_state_t.CLIMBING

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Verdict:
    """How a climb went; lengths in metres, forces in newtons."""

    reached_goal: bool
    fell: bool
    """the body left its path; a robot that hangs on by its other limbs has not fallen"""
    fall_reason: str
    lost_grips: dict[str, float]
    """limbs that lost their hold in stance, and when [s]"""
    slips: int
    largest_slip_m: float
    goal_error_m: float
    goal_error_rad: float
    link_contact_force_n: float


@dataclass(frozen=True)
class Tracking:
    """How well what was logged as wanted became true; None where the log has no such cycle."""

    body_max_m: float | None = None
    body_rms_m: float | None = None
    finger_max_m: float | None = None
    """of the gripper centres"""
    force_rms_n: float | None = None
    """of the contact forces of limbs under their whole load"""


def pad_travel(
    truth: Truth,
    face_hold: Ints,
    contact_force_n: float,
    point_feet: bool = False,
    sides: Floats | None = None,
    stands: Bools | None = None,
) -> list[float]:
    """Largest tangential travel [m] of every loaded episode of every pad; `sides` (holds, 4, 3) are the normals of the
    holds' side faces, where some lean; `stands` (4,): limbs that have footholds too, on the wall.

    An episode begins when a pad on a hold (point feet: on the wall) presses with `contact_force_n` and ends when its
    force is nearly gone; a foot on a foothold presses with both of its pads.
    """
    travels: list[float] = []
    for pad in range(truth.pad_force_n.shape[1]):
        start: Floats | None = None
        normal = np.zeros(3)
        furthest = 0.0
        force, face = truth.pad_force_n[:, pad], truth.pad_face[:, pad]
        on_wall = (face >= 0) & (face_hold[face] < 0)
        on_hold = on_wall if point_feet else (face >= 0) & ~on_wall
        if stands is not None and stands[pad // 2]:
            feet = truth.pad_face[:, pad // 2 * 2 : pad // 2 * 2 + 2]
            on_wall = ~on_hold & ((feet >= 0) & (face_hold[feet] < 0)).any(axis=1)
            force = np.where(on_wall, truth.pad_force_n[:, pad // 2 * 2 : pad // 2 * 2 + 2].sum(axis=1), force)
            on_hold = on_hold | on_wall
        for i in range(len(force)):
            position = truth.pad_position_m[i, pad]
            if start is None:
                if on_hold[i] and force[i] >= contact_force_n:
                    start, furthest = position, 0.0
                    # pads press along the gripper's opening axis, feet along its z
                    normal = truth.gripper_rotation[i, pad // 2, :, 2 if on_wall[i] else 0]
                    if sides is not None and not on_wall[i]:
                        mine = sides[face_hold[face[i]]]
                        normal = mine[(mine @ normal * (1 - 2 * (pad % 2))).argmax()]
                continue
            if not on_hold[i] or force[i] < UNLOADED_SHARE * contact_force_n:
                travels.append(furthest)
                start = None
                continue
            moved = position - start
            furthest = max(furthest, float(np.linalg.norm(moved - normal * (normal @ moved))))
        if start is not None:
            travels.append(furthest)
    return travels


def _leaning_sides(plan: Any) -> Floats | None:
    """(holds, 4, 3) normals of the holds' side faces in W; None where none leans."""
    if not any(any(hold.lean_rad) for hold in plan.holds):
        return None
    outward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    lean = np.array([hold.lean_rad for hold in plan.holds])[..., None]
    own = np.cos(lean) * outward + np.sin(lean) * np.array([0.0, 0.0, 1.0])
    turned: Floats = np.einsum("hij,hfj->hfi", np.array([hold_rotation(hold) for hold in plan.holds]), own)
    return turned


def contact_forces_w(truth: Truth, plan: Any, hand_mass_kg: Floats) -> Floats:
    """Forces of the holds on the grippers, frame W, (n, 4, 3): the hand's weight taken off."""
    force_w = np.einsum("nlij,nlj->nli", truth.gripper_rotation, truth.hand_wrench_g[:, :, :3])
    return np.asarray(force_w - hand_mass_kg[None, :, None] * np.array(plan.gravity_w_m_s2))


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """First and one past the last sample of each run of True in `flags` (n,)."""
    padded = np.concatenate([[False], flags, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def long_runs(flags: Bools, least: int) -> Bools:
    """`flags` (n,) with every run of True shorter than `least` taken out."""
    kept = flags.copy()
    for begin, end in _runs(flags):
        if end - begin < least:
            kept[begin:end] = False
    return kept


def _rms(values: Floats) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _largest(values: Floats) -> float | None:
    return float(values.max()) if values.size else None


def _opened(truth: Truth, gone: Bools, soon: int) -> Bools:
    """Which of the samples off a hold, `gone` (n, 4), begin with fingers that open: their pads come further apart than
    they were on the hold, within `soon` samples."""
    pads_m = truth.pad_position_m.reshape(-1, len(LIMB_NAMES), 2, 3)
    apart_m = np.linalg.norm(pads_m[:, :, 0] - pads_m[:, :, 1], axis=2)
    opened = np.zeros_like(gone)
    for limb in range(len(LIMB_NAMES)):
        for begin, end in _runs(gone[:, limb]):
            widest_m = apart_m[begin : min(begin + soon, end), limb].max()
            opened[begin:end, limb] = widest_m > apart_m[max(begin - 1, 0), limb] + OPENED_M
    return opened


def _off(truth: Truth, robot: RobotModel) -> tuple[Bools, Bools]:
    """(n, 4) each: limbs that are off every hold, by one finger, and off the wall, where feet stand on one pad too.
    Fingers that touch the wall are off their hold; of a limb that never stands there it counts as nothing.
    """
    on_wall = (truth.pad_face >= 0) & (robot.face_hold[truth.pad_face] < 0)
    touches = truth.pad_face >= 0 if robot.point_feet else on_wall
    pads = (-1, len(LIMB_NAMES), 2)
    off_hold = ((truth.pad_face < 0) | on_wall).reshape(pads).any(axis=2)
    off_wall: Bools = ~touches.reshape(pads).any(axis=2) | ~robot.stands
    return np.asarray(off_hold), off_wall


def _mishaps(
    truth: Truth, plan: Any, robot: RobotModel, given_up: Collection[int] = ()
) -> tuple[list[str], dict[str, float]]:
    """What makes the run a fall, and the grips lost in stance, but those of limbs in `given_up`."""
    dt_s = float(robot.model.opt.timestep)
    lost_samples = int(LOST_HOLD_S / (contact_period() * dt_s)) + 1
    time_s = truth.cycle * dt_s
    off_hold, off_wall = _off(truth, robot)
    off = off_hold & off_wall if robot.stands.any() else off_hold
    gone = np.stack([long_runs(limb, lost_samples) for limb in off.T], axis=1)
    reference = PlanReference(plan)
    step_s: Floats = np.diff(time_s, prepend=time_s[:1]) * truth.climbing
    plan_s, stance = ReferenceClock(reference).play(
        step_s, gone, _opened(truth, gone, int(OPENS_S / (contact_period() * dt_s)))
    )
    begun = np.maximum.accumulate(truth.climbing != 0)

    # The clock may lead or lag; the body keeps to its path.
    if robot.stands.any() and not robot.point_feet:
        series = plan_series(plan)
        off = np.where(series.on_wall[series.knot_at(plan_s)], off_wall, off_hold)
    lead_s = LEAD_INTERVALS * reference.step_s.max()
    near_s = [np.clip(plan_s + d, 0.0, reference.end_s) for d in np.linspace(-lead_s, lead_s, 25)]
    off_path_m = [np.linalg.norm(truth.body_position_m - reference.body(at_s)[0], axis=1) for at_s in near_s]
    # Before the start a hand may carry the robot; one that never starts must be there at the end.
    counted = begun if begun.any() else np.arange(len(begun)) == len(begun) - 1
    body_off = counted & ~(np.min(off_path_m, axis=0) <= FALL_M)  # nowhere, in numbers, is not near either
    hangs = (truth.climbing == 0) & ~(gone & stance).any(axis=1)  # limp, as without power, but by all that should hold
    body_off &= ~(begun & hangs)
    reasons = []
    if body_off.any():
        at_s = time_s[np.argmax(body_off)]
        reasons.append(f"the body was more than {FALL_M * 1e3:.0f} mm off its path at {at_s:.1f} s")
    without = off & stance & begun[:, None]
    lost_at_s: dict[str, float] = {}
    for limb, name in enumerate(LIMB_NAMES):
        lost = long_runs(without[:, limb], lost_samples)
        if lost.any() and limb not in given_up:
            lost_at_s[name] = float(time_s[np.argmax(lost)])
    return reasons, lost_at_s


def _legs(truth: Truth, legs: Sequence[tuple[int, Any]]) -> Iterator[tuple[Truth, Any, list[int]]]:
    """The samples of each plan climbed, from the cycle it was taken in, and the limbs in the air where the next begins:
    they have lost their holds, which that plan goes on from."""
    ends = [*(cycle for cycle, _ in legs[1:]), np.inf]
    for i, ((begin, plan), end) in enumerate(zip(legs, ends, strict=True)):
        rows = (truth.cycle >= begin) & (truth.cycle < end)
        following = legs[i + 1][1].knots[0].limbs if i + 1 < len(legs) else []
        if rows.any():
            part = Truth(**{name: values[rows] for name, values in vars(truth).items()})
            yield part, plan, [limb for limb, knot in enumerate(following) if knot.phase == limb_knot_t.AIR]


def judge(
    truth: Truth, plan: Any, robot: RobotModel, complete: bool, further: Sequence[tuple[int, Any]] = ()
) -> Verdict:
    """The verdict on a run of at least one sample, from its first climbing cycle to its end.

    `robot` is the model it ran on, `complete` whether the last plan was played to its end, `further` the plans taken on
    the way and the cycles they were taken in. The goal is that of the first.
    """
    found = [_mishaps(part, leg, robot, given_up) for part, leg, given_up in _legs(truth, [(0, plan), *further])]
    reasons = [reason for falls, _ in found for reason in falls]
    lost_grips: dict[str, float] = {}
    for _, lost in found:
        lost_grips = lost | lost_grips
    contact_N = robot.robot.control.contact_force_N
    stands = None if robot.point_feet else robot.stands
    travels = pad_travel(truth, robot.face_hold, contact_N, robot.point_feet, _leaning_sides(plan), stands)
    slip_m = WALK_SLIP_M if robot.point_feet else SLIP_M
    goal_position, goal_rotation = goal_pose(plan)
    goal_error_m = float(np.linalg.norm(truth.body_position_m[-1] - goal_position))
    goal_error_rad = angle_between(goal_rotation, rotations_from_quaternions(truth.body_quaternion[-1:])[0])
    return Verdict(
        reached_goal=complete and goal_error_m <= plan.goal_tolerance_m and goal_error_rad <= plan.goal_tolerance_rad,
        fell=bool(reasons),
        fall_reason="; ".join(reasons),
        lost_grips=lost_grips,
        slips=sum(travel > slip_m for travel in travels),
        largest_slip_m=max(travels, default=0.0),
        goal_error_m=goal_error_m,
        goal_error_rad=goal_error_rad,
        link_contact_force_n=float(truth.link_contact_force_n.max(initial=0.0)),
    )


def track(truth: Truth, log: Any, since: int, plan: Any, robot: RobotModel) -> Tracking:
    """Physics against the references in `log`, a telemetry.Telemetry of the same run, in the cycles that both have from
    `since` on, when `plan` was taken."""
    logged = log.state["cycle"]
    climbing = np.flatnonzero((log.state["supervisor_state"] == CLIMBING) & (logged >= since))
    if not len(climbing):
        return Tracking()
    row = np.clip(np.searchsorted(logged, truth.cycle), 0, len(logged) - 1)
    state, references = log.state[row], log.references[row]
    run = (logged[row] == truth.cycle) & (truth.cycle >= logged[climbing[0]])
    body_reference_m, _ = PlanReference(plan).body(state["plan_time_s"])
    body_error = np.linalg.norm(truth.body_position_m - body_reference_m, axis=1)[run]
    fresh = run & log.limbs_fresh[row]
    gripper_error = np.linalg.norm(truth.gripper_position_m - references["gripper_position_w_m"], axis=2)[fresh]
    loaded = (references["phase"] == STANCE) & fresh[:, None] & (references["load"] > FULL_LOAD)
    contact_force = contact_forces_w(truth, plan, robot.model.body_subtreemass[robot.gripper_bodies])
    force_error = np.linalg.norm(contact_force - log.limbs[row]["force_reference_w_n"], axis=2)[loaded]
    return Tracking(_largest(body_error), _rms(body_error), _largest(gripper_error), _rms(force_error))
