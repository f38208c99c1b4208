"""What is known of a climb in simulation once it has ended."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_msgs import truth_verdict_t
from crux_tools.robot3d.robot_model import RobotModel

from crux_simulation.sim.disturbance import Course
from crux_simulation.sim.judge import Tracking, Verdict
from crux_simulation.sim.loop import Ending, Outcome
from crux_simulation.sim.recorder import Truth


@dataclass(frozen=True)
class ClimbResult:
    """Everything known after a climb."""

    outcome: Outcome
    verdict: Verdict
    tracking: Tracking
    real_time_factor: float
    missed_cycles: int
    reason: str
    log: Path
    log_complete: bool
    bus: str = "memory"
    """as in ClimbOptions"""
    courses: tuple[Course, ...] = ()
    joint_notes: tuple[str, ...] = ()
    """limits of the joints that were passed, as the report says it"""
    worst_interrupts: dict[str, int] | None = None
    """instructions, of the emulated boards"""
    guide: dict[str, Any] | None = None
    """what it did, as `--json` prints it"""
    replans: dict[str, Any] | None = None
    """what was planned again on the way, as `--json` prints it"""
    truth: Truth | None = None
    model: RobotModel | None = None
    """that it ran on"""

    @property
    def ok(self) -> bool:
        """The robot reached the goal without a slip, a lost grip or a fall, and the log is complete."""
        verdict = self.verdict
        went_well = verdict.reached_goal and not verdict.fell and not verdict.lost_grips and verdict.slips == 0
        return went_well and self.log_complete

    def as_json(self) -> dict[str, Any]:
        """The object `crux climb --json` prints."""
        verdict, tracking = self.verdict, self.tracking
        result: dict[str, Any] = {
            "ok": self.ok,
            "reached_goal": verdict.reached_goal,
            "fell": verdict.fell,
            "lost_grips": list(verdict.lost_grips),
            "slips": verdict.slips,
            "tracking": {
                "body_m": tracking.body_max_m,
                "finger_m": tracking.finger_max_m,
                "force_N": tracking.force_rms_n,
                "body_rms_m": tracking.body_rms_m,
            },
            "goal_error": {"m": verdict.goal_error_m, "rad": verdict.goal_error_rad},
            "largest_slip_m": verdict.largest_slip_m,
            "real_time_factor": self.real_time_factor,
            "missed_cycles": self.missed_cycles,
            "cycles": self.outcome.cycles,
            "bus": self.bus,
            "log": str(self.log),
            "log_complete": self.log_complete,
            "reason": self.reason,
            "joint_notes": self.joint_notes,
        }
        if self.worst_interrupts is not None:
            result["worst_interrupts"] = self.worst_interrupts
        if self.guide is not None:
            result["guide"] = self.guide
        if self.replans is not None:
            result["replans"] = self.replans
        if self.outcome.robot_on_wall is not None:
            result["robot_on_wall"] = self.outcome.robot_on_wall
        if self.courses:
            result["robot_on_wall"] = not verdict.fell and self.outcome.robot_on_wall is not False
            result["faults"] = [course.as_json() for course in self.courses]
        return result

    def as_message(self, world: str = "") -> truth_verdict_t:
        """What the log says of it on /truth/verdict; `world`: the name of a world file."""
        message, verdict = truth_verdict_t(), self.verdict
        message.world = world
        message.ok, message.log_complete, message.reason = self.ok, self.log_complete, self.reason
        for name, value in vars(verdict).items():
            if hasattr(message, name):  # lost grips stand in the reason
                setattr(message, name, value)
        return message


def reason_of(outcome: Outcome, verdict: Verdict, faults: list[str]) -> str:
    """Why a climb failed, with the `faults` that the runtime reported; empty when nothing went wrong."""
    parts = []
    if outcome.ending is Ending.RUNTIME_DIED:
        parts.append(f"{outcome.ending.value} in cycle {outcome.cycles}")
        on_wall = "held the robot on the wall" if outcome.robot_on_wall else "did not hold the robot"
        parts.append(f"the nodes {on_wall} for the next 3 s")
    elif outcome.ending is not Ending.COMPLETE:
        parts.append(outcome.ending.value)
    parts += faults
    if verdict.fell:
        parts.append(verdict.fall_reason)
    parts += [f"limb {limb} lost its hold in stance at {at_s:.1f} s" for limb, at_s in verdict.lost_grips.items()]
    if verdict.slips:
        parts.append(f"{verdict.slips} slips, the largest {verdict.largest_slip_m * 1e3:.1f} mm")
    if outcome.ending is Ending.COMPLETE and not verdict.reached_goal:
        parts.append(
            f"the body ended {verdict.goal_error_m * 1e3:.1f} mm and {np.degrees(verdict.goal_error_rad):.1f} deg "
            "off the goal"
        )
    return "; ".join(parts)
