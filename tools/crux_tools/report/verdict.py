"""How a climb went in one sentence, and when, where and by which versions it was run."""

from __future__ import annotations

from collections import Counter

import numpy as np
from crux_contracts.interpolation import is_walk
from crux_msgs import truth_verdict_t

from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.description import SHOWN
from crux_tools.telemetry.rotations import angle_between, goal_pose, rotations_from_quaternions
from crux_tools.telemetry.summary import FaultNote, Summary
from crux_tools.telemetry.wording import judged

NOT_RECORDED = "not recorded"
APPLIED = "with the squeeze the robot applies"
PLANNED = "with the plan's squeeze"
# (what, keys of the log's metadata "crux" that tell it); logs of earlier runtimes lack most of them
FACTS = (
    ("started (UTC)", ("started_utc",)),
    ("host", ("host",)),
    ("crux", ("version", "commit")),
    ("seed", ("seed",)),
    ("command", ("command_line",)),
    ("note", ("note",)),
    ("robot", ("robot", "robot_sha256")),
)


def facts(log: Telemetry) -> list[tuple[str, str]]:
    """When, where and with what, as rows of a table; what an earlier runtime did not write is said to be missing, a
    note that nobody gave is not.
    """
    # crux climb's own command stands before that of the runtime it starts.
    told = {key: value[:SHOWN] if key.endswith("sha256") else value for key, value in log.metadata.items()}
    told["command_line"] = told.get("crux_command_line", told.get("command_line", ""))
    rows = [(what, " ".join(told.get(key, "") for key in keys).strip()) for what, keys in FACTS]
    return [(what, text or NOT_RECORDED) for what, text in rows if text or what != "note"]


def _faults(faults: list[FaultNote]) -> str:
    counted = Counter(f"{fault.code} {fault.name}{f' ({fault.limb})' if fault.limb else ''}" for fault in faults)
    names = [f"{name}{f' {count} times' if count > 1 else ''}" for name, count in counted.items()]
    return f"fault{'s' if len(faults) > 1 else ''} {', '.join(names)}" if names else "no fault"


def _off(distance_m: float, angle_rad: float, log: Telemetry) -> str:
    allowed = f"{log.plan.goal_tolerance_m * 1e3:.0f} mm and {np.degrees(log.plan.goal_tolerance_rad):.0f} deg allowed"
    return f"{distance_m * 1e3:.1f} mm and {np.degrees(angle_rad):.1f} deg off the goal ({allowed})"


def _estimated(log: Telemetry) -> str:
    """Off the goal as the runtime sees itself at the end."""
    last = log.state[-1]
    position_m, rotation = goal_pose(log.plan)
    distance_m = float(np.linalg.norm(last["body_position_w_m"] - position_m))
    turn_rad = angle_between(rotation, rotations_from_quaternions(last["body_quaternion_w"][None])[0])
    return _off(distance_m, turn_rad, log)


def sentence(log: Telemetry, summary: Summary, least_margin_N: float, verdict: truth_verdict_t | None) -> str:
    """The `verdict` of the judge, who sees physics; without one what the rest of the log can tell."""
    if log.plan is None:
        return f"Not climbed: no plan was accepted, {_faults(summary.faults)}."
    whose = "" if is_walk(log.plan) else f" {APPLIED}"
    margin = f"least margin {least_margin_N:.2f} N{whose}" if np.isfinite(least_margin_N) else "never in full stance"
    if verdict is not None:
        off = _off(verdict.goal_error_m, verdict.goal_error_rad, log)
        told = [off, *judged(verdict), _faults(summary.faults), margin]
        return f"{'Climbed' if verdict.ok else 'Failed'}: {', '.join(told)}."
    head = "Plan completed" if summary.plan_complete else f"Plan not completed, ended in {summary.final_state}"
    return (
        f"{head}, by the log alone: {_estimated(log)} by the runtime's own estimate, {_faults(summary.faults)}, "
        f"{margin}; without ground truth in it a log does not tell slips and falls."
    )
