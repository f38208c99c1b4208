"""What a log shows in the second before a fault, in sentences that name the limb, the node and how much.

Each function looks for one thing, whatever fault the runtime told, and says nothing where that is as it should be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.plan_series import plan_series
from crux_msgs import bus_health_t

from crux_tools.log.seen import COMMAND_WORDS
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.summary import (
    WAIT_NAMES,
    FaultNote,
    body_error_m,
    in_full_stance,
    is_realtime,
    name_of,
    wrench_error,
)

BEFORE_S = 1.0
SILENT_CYCLES = 3  # not heard for so long counts
FROZEN_S = 0.1
MOVED_RAD = 1e-3  # of a command whose encoder stands still
LATE_S = 1e-3
MOST_MISSING = 20  # cycles in turn
SLID_M, GAVE_WAY_M = 5e-4, 2e-3
USUAL = 3.0  # so many times the median of the climb until then is not usual
BUS_WORDS = {getattr(bus_health_t, name): name for name in dir(bus_health_t) if name.isupper()}
COUNTED = (
    ("crc_errors", "damaged"),
    ("lost", "lost"),
    ("repeated", "repeated"),
    ("foreign", "of another host"),
    ("error_frames", "error frames"),
)


@dataclass(frozen=True)
class Moment:
    """A fault and the rows of the log that end with its cycle."""

    log: Telemetry
    fault: FaultNote
    first: int
    row: int

    @property
    def rows(self) -> slice:
        return slice(self.first, self.row + 1)

    def since(self, row: int) -> str:
        """A time in words."""
        return f"{self.log.time_s[row]:.3f} s"


def moment_of(log: Telemetry, fault: FaultNote) -> Moment:
    """The second before it, as far as the log has it."""
    row = max(int(np.searchsorted(log.time_s, fault.time_s + 1e-9, "right")) - 1, 0)
    return Moment(log, fault, int(np.searchsorted(log.time_s, fault.time_s - BEFORE_S)), row)


def stories(faults: list[FaultNote]) -> list[list[FaultNote]]:
    """Faults in the order of time; those within a second of the one before are its story's consequences."""
    told: list[list[FaultNote]] = []
    for fault in sorted(faults, key=lambda each: each.time_s):
        if told and fault.time_s - told[-1][-1].time_s <= BEFORE_S:
            told[-1].append(fault)
        else:
            told.append([fault])
    return told


def fresh_nodes(log: Telemetry, rows: slice) -> np.ndarray:
    """(n, 4, S + 1) whether a node's status came: joints from the shoulder, then the gripper."""
    return np.asarray(_of_nodes(log.inputs["joint_fresh"][rows], log.inputs["gripper_fresh"][rows]) != 0)


def part_of(index: int, parts: int) -> str:
    """What a node of a limb moves, by its place among all `parts` of fresh_nodes()."""
    return "gripper" if index == parts - 1 else f"joint {index + 1}"


def _of_nodes(joints: np.ndarray, grippers: np.ndarray) -> np.ndarray:
    return np.asarray(np.concatenate([joints.reshape(len(joints), len(LIMB_NAMES), -1), grippers[:, :, None]], axis=2))


def _standing(same: np.ndarray) -> np.ndarray:
    """(n, ...) of truths: how many of the last rows are true without a break, (...)."""
    return np.asarray(np.where(same.all(axis=0), len(same), np.argmin(same[::-1], axis=0)))


def late(at: Moment) -> Iterator[str]:
    """Cycles that began late, and whether the runtime's own computing made them so."""
    late_s = _column(at.log.inputs, "late_s")
    if late_s is None or not is_realtime(at.log):
        return
    most = at.first + int(np.argmax(late_s[at.rows]))
    if late_s[most] < LATE_S:
        return
    usual_s = float(np.median(late_s[: at.row + 1]))
    timing, cycle = at.log.timing, int(at.log.inputs["cycle"][most])
    near = timing[(timing["cycle"] >= cycle - 2) & (timing["cycle"] <= cycle)] if len(timing) else timing
    words = f"The cycle at {at.since(most)} began {late_s[most] * 1e3:.1f} ms late (usual: {usual_s * 1e3:.2f} ms)"
    if len(near):
        own_ms = near["compute_ns"].max() / 1e6
        words += f"; computing took the runtime {own_ms:.2f} ms: "
        words += "that is why" if own_ms / 1e3 > late_s[most] / 2 else "the computer gave it no time"
    yield words + "."


def buses(at: Moment) -> Iterator[str]:
    """What the CAN controllers said, and frames that did not count."""
    state = _column(at.log.inputs, "bus_state")
    for limb, name in enumerate(LIMB_NAMES):
        if state is not None and state[at.row, limb] != bus_health_t.ACTIVE:
            since = at.row + 1 - int(_standing(state[at.rows, limb] != bus_health_t.ACTIVE))
            word = BUS_WORDS.get(int(state[at.row, limb]), "?")
            yield f"The CAN controller of {name} says {word} since {at.since(since)}."
    health, cycle = at.log.buses, at.log.inputs["cycle"]
    for limb, name in enumerate(LIMB_NAMES if len(health) else ()):
        told = health[health["limb"] == limb]
        first, last = (int(np.searchsorted(told["cycle"], cycle[row])) for row in (at.first, at.row))
        if first == 0 or last >= len(told):
            continue
        counts = [(int(told[field][last]) - int(told[field][first - 1]), word) for field, word in COUNTED]
        if words := ", ".join(f"{count} {word}" for count, word in counts if count > 0):
            yield f"On the bus of {name} frames did not count: {words}."


def silent_nodes(at: Moment) -> Iterator[str]:
    """Nodes whose statuses stay away, and what they have in common."""
    fresh = fresh_nodes(at.log, at.rows)
    for_rows = _standing(~fresh)
    silent = for_rows >= SILENT_CYCLES
    if silent.all():
        yield (
            f"No node of any limb was heard since {at.since(at.row + 1 - int(for_rows.min()))}: this computer did "
            "not listen, or all power was off."
        )
        return
    for limb, name in enumerate(LIMB_NAMES):
        since = at.since(at.row + 1 - int(for_rows[limb].max()))
        gone = [part_of(int(part), len(silent[limb])) for part in np.flatnonzero(silent[limb])]
        if len(gone) == len(silent[limb]):
            yield (
                f"All {len(gone)} nodes of {name} are silent since {since}, those of other limbs are heard: "
                "the bus of that limb is cut, or its nodes have no power."
            )
        elif gone:
            yield (
                f"{name} {', '.join(gone)} silent since {since}, the other nodes of that bus are heard: its power, its "
                "plug or its firmware."
            )
        elif (share := 1 - fresh[:, limb].mean()) > 0.01:
            yield f"{100 * share:.0f} % of the answers of {name}'s nodes did not come: frames get lost on that bus."


def node_states(at: Moment) -> Iterator[str]:
    """Nodes that report faults, and nodes that hold by themselves while the runtime commands motion."""
    states: dict[int, Any] = can_codec.message("JointStatus", 1).get_signal_by_name("State").choices or {}
    inputs = at.log.inputs[at.rows]
    state = _of_nodes(inputs["joint_state"], inputs["gripper_state"])
    faults = _of_nodes(inputs["joint_faults"], inputs["gripper_faults"])[-1]
    usual = np.bincount(state[0].ravel().astype(int)).argmax()
    for limb, node in zip(*np.nonzero((state[-1] != usual) | (faults != 0)), strict=True):
        same = _standing(state[:, limb, node] == state[-1, limb, node])
        bits = can_codec.fault_causes(int(faults[limb, node]))
        place = f"{LIMB_NAMES[limb]} {part_of(int(node), len(faults[limb]))}"
        words = f"{place} is in {states.get(int(state[-1, limb, node]), '?')} since "
        yield words + at.since(at.row + 1 - int(same)) + (f" and reports {', '.join(bits)}." if bits else ".")


def frozen_sensors(at: Moment) -> Iterator[str]:
    """Numbers that do not change any more: encoders while their commands move, others for longer than ever before."""
    log, n = at.log, len(LIMB_NAMES)
    whole, step_s = slice(0, at.row + 1), float(at.log.inputs["dt_s"][0])
    measured, command = log.inputs["joint_position_rad"][whole], log.outputs["joint_position_rad"][whole]
    stands = _standing(measured == measured[-1])
    for joint in np.flatnonzero((stands * step_s >= FROZEN_S) & (np.median(stands) * step_s < FROZEN_S)):
        since = at.row + 1 - int(stands[joint])
        moved_rad = float(np.ptp(command[since:, joint]))
        limb, number = divmod(int(joint), len(stands) // n)
        if moved_rad > MOVED_RAD:
            yield (
                f"The encoder of {LIMB_NAMES[limb]} joint {number + 1} gives the very same number "
                f"({measured[-1, joint]:.5f} rad) since {at.since(since)}, while its command moved by "
                f"{moved_rad * 1e3:.1f} mrad."
            )
    for field, what in (("ft_force_g_n", "force/torque sensor"), ("finger_force_n", "gripper force")):
        values = log.inputs[field][whole].reshape(at.row + 1, n, -1)
        changed = (np.diff(values, axis=0) != 0).any(axis=2)
        for limb, name in enumerate(LIMB_NAMES):
            changes = np.flatnonzero(changed[:, limb])
            usual = int(np.diff(changes).max(initial=0))
            if len(changes) and (at.row - changes[-1]) > max(USUAL * usual, FROZEN_S / step_s):
                yield f"The {what} of {name} gives the very same numbers since {at.since(int(changes[-1]) + 1)}."


def gave_way(at: Moment) -> Iterator[str]:
    """The gripper that moved on its hold against the others', the fault's own or that which moved most, and the pull
    under which it did."""
    shift = _column(at.log.limbs, "stance_shift_g_m")
    if shift is None:
        return
    moved_m = np.linalg.norm(shift[at.rows] - shift[at.first], axis=2).max(axis=0)
    limb = LIMB_NAMES.index(at.fault.limb) if at.fault.limb in LIMB_NAMES else int(moved_m.argmax())
    if moved_m[limb] < GAVE_WAY_M:
        return
    limbs = at.log.limbs[at.rows, limb]
    pulls_N = np.linalg.norm(limbs["force_w_n"], axis=1)
    most, friction = int(pulls_N.argmax()), float(at.log.references["friction"][at.row, limb])
    yield (
        f"{LIMB_NAMES[limb]} moved by {moved_m[limb] * 1e3:.1f} mm on {hold_of(at, limb) or 'its hold'} against the "
        f"other grips, under up to {pulls_N[most]:.0f} N while each finger pressed with "
        f"{limbs['grasp_force_n'][most]:.0f} N; the plan counts on a friction of {friction:.2g} there."
    )


def waits(at: Moment) -> Iterator[str]:
    """What the plan's clock had waited for when it came to that."""
    state = at.log.state
    row = max(at.row - 1, 0)
    reason, limb = int(state["waiting_for"][row]), int(state["waiting_limb"][row])
    if reason:
        same = _standing((state["waiting_for"][: row + 1] == reason) & (state["waiting_limb"][: row + 1] == limb))
        who = name_of(LIMB_NAMES, limb) if limb >= 0 else "all limbs"
        hold = hold_of(at, limb) if 0 <= limb < len(LIMB_NAMES) else ""
        where = f" at {hold}" if hold else ""
        since = at.since(row + 1 - int(same))
        yield f"The plan's clock had waited for {who} to {name_of(WAIT_NAMES, reason)}{where} since {since}."


def slips(at: Moment) -> Iterator[str]:
    """Grippers that slid on their holds, at which friction, and what the plan counts on."""
    slid = _column(at.log.limbs, "slip_m")
    if slid is None:
        return
    for limb, name in enumerate(LIMB_NAMES):
        most_m = float(slid[at.rows, limb].max())
        if most_m < SLID_M:
            continue
        words = f"{name} slid by {most_m * 1e3:.1f} mm on {hold_of(at, limb) or 'its hold'}"
        felt = float(at.log.limbs["slip_friction"][at.row, limb])
        planned = float(at.log.references["friction"][at.rows, limb].max())
        smoother = ": the hold is smoother than planned" if 0 < felt < planned else ""
        yield f"{words} at friction {felt:.2f}; the plan counts on {planned:.2f}{smoother}."


def hold_of(at: Moment, limb: int) -> str:
    """The hold that the plan has a limb on or takes it to; empty where there is none."""
    if at.log.plan is None:
        return ""
    series = plan_series(at.log.plan)
    knot = int(series.knot_at(at.log.state["plan_time_s"][at.row : at.row + 1])[0])
    later = series.hold[knot:, limb]
    found = later[later >= 0]
    return series.hold_name(int(found[0])) if len(found) else ""


def far_off(at: Moment) -> Iterator[str]:
    """Forces and body far off the plan, against what they were until then."""
    log, until = at.log, slice(0, at.first)
    stance = in_full_stance(log)
    force = wrench_error(log)[0]
    for limb, name in enumerate(LIMB_NAMES):
        before, now = force[until, limb][stance[until, limb]], force[at.rows, limb][stance[at.rows, limb]]
        if len(before) and len(now) and now.max() > max(USUAL * np.median(before), 2.0):
            yield f"The force on {name} was up to {now.max():.1f} N off the plan (usual: {np.median(before):.1f} N)."
    body = body_error_m(log)
    before = body[until]
    if len(before) and body[at.rows].max() > max(USUAL * np.median(before), 3e-3):
        yield (
            f"The body was up to {body[at.rows].max() * 1e3:.1f} mm off its reference (usual: "
            f"{np.median(before) * 1e3:.1f} mm)."
        )


def commands(at: Moment) -> Iterator[str]:
    """What an operator asked for."""
    for given in at.log.inputs["operator_command"][at.rows]:
        if given:
            yield f"The operator gave {COMMAND_WORDS.get(int(given), f'#{given}')}."


SEARCHES: tuple[Callable[[Moment], Iterator[str]], ...] = (
    late, buses, silent_nodes, node_states, frozen_sensors, slips, gave_way, waits, far_off, commands,
)  # fmt: skip


def evidence(at: Moment) -> list[str]:
    """All of it, what is nearest to a cause first; nothing where the log has only some of the cycles."""
    if (np.diff(at.log.inputs["cycle"][at.rows]) > MOST_MISSING).any():
        return []
    return [sentence for search in SEARCHES for sentence in search(at)]


def _column(table: np.ndarray, name: str) -> np.ndarray | None:
    """None in logs of earlier runtimes, which do not have it."""
    return table[name] if name in (table.dtype.names or ()) else None
