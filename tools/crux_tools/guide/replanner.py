"""Beside a climb: after each new grasp the moves that follow are planned again on the map as it was measured.

The robot climbs on meanwhile. What is planned begins in the stance after the move that is being made; it goes to the
runtime if that is still ahead, and otherwise the robot climbs on as it was planned before.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from typing import Any

from crux_contracts.plan_file import plan_id
from crux_contracts.plan_route import join_knot, joined
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_msgs import plan_t, robot_state_t, status_t
from crux_planner import InfeasibleError, Planner, PlanResult, stances

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.guide.measured import Found, found_holds, interval_of, scenario_with
from crux_tools.guide.situation import refuse_feet
from crux_tools.operator_link import OperatorLink
from crux_tools.telemetry.channels import REPLANNED

PLANNING_S = 3.0  # of computing
EARLY_S = 1e-6  # a knot counts as reached


@dataclass(frozen=True)
class Replan:
    """One time that moves were planned again."""

    time_s: float
    """of the runtime's cycles, when it was begun"""
    why: str
    from_s: float
    """plan time of the stance from which it was planned"""
    seconds: float
    """of planning and check, by the wall's clock"""
    computed_s: float
    """the same in CPU time, which says more on a busy machine"""
    parts: dict[str, float]
    """of that, by what was done"""
    kept: bool
    """the robot climbs it"""
    outcome: str

    def __str__(self) -> str:
        took = f"{self.seconds:.2f} s for the way from {self.from_s:.1f} s"
        return f"{self.time_s:.1f} s: {self.why}; {took}: {self.outcome}"


@dataclass
class Replanner:
    """Of one climb. `plan` is what the runtime climbs; `say` hears of every plan that is made, `pause` is called
    between planning and upload.
    """

    link: OperatorLink
    plan: plan_t
    robot: Robot
    say: Callable[[str], None]
    pause: Callable[[], None] = lambda: None
    made: list[Replan] = field(default_factory=list, init=False)
    _seen: int = field(default=1, init=False)  # stances that were looked at; the plan's start is as it was measured

    def __post_init__(self) -> None:
        refuse_feet(self.plan)
        # Everything that planning needs is loaded before it is needed.
        with suppress(InfeasibleError):
            Planner(parse_scenario(self.plan.scenario_yaml), self.robot).replan(self.plan, 0.0, quick=True)

    def attend(self, ask: Callable[[], status_t | None]) -> None:
        """Looks at the runtime by `ask`, and plans again where a limb has come to bear on a hold that is not as the
        plan has it. Nothing is raised where that leads to no plan, or the runtime does not take it.
        """
        status = ask()
        if status is None or not _climbs(status):
            return
        times_s = [self.plan.knots[k].time_s for k in stances(self.plan)]
        reached = sum(time_s <= status.state.verified_time_s + EARLY_S for time_s in times_s)
        if reached <= self._seen:
            return
        self._seen = reached
        found = found_holds(self.plan, status)
        ahead = [k for k in stances(self.plan) if k > interval_of(self.plan, status) + 1]
        if found and len(ahead) > 1:  # a move is left after that stance
            self.made.append(self._replan(status, found, ahead[0], ask))
            self.say(str(self.made[-1]))

    def _replan(self, status: status_t, found: list[Found], knot: int, ask: Callable[[], status_t | None]) -> Replan:
        from_s = float(self.plan.knots[knot].time_s)
        why, began_s, computed_s = "; ".join(map(str, found)), time.monotonic(), time.process_time()
        result: PlanResult | None = None
        try:
            planner = Planner(scenario_with(self.plan, found), self.robot)
            result = planner.replan(self.plan, from_s, quick=True, time_limit_s=PLANNING_S)
            outcome = ""
        except (InfeasibleError, ScenarioError) as none:
            outcome = f"no plan: {none}"
        seconds, computed_s = time.monotonic() - began_s, time.process_time() - computed_s
        if result is not None:
            self.pause()
            outcome = self._hand_over(result.plan, why, ask())
        parts = {} if result is None else result.timing
        return Replan(status.state.time_s, why, from_s, seconds, computed_s, parts, not outcome, outcome or "kept")

    def _hand_over(self, part: plan_t, why: str, status: status_t | None) -> str:
        """Why the robot does not climb the part; empty where it does."""
        part.method = REPLANNED + why
        part.plan_id = plan_id(part)
        if status is None or not _climbs(status):
            return "the robot does not climb any more"
        if (knot := join_knot(self.plan, part)) == 0:
            return "it begins in no stance of the plan that runs"
        if interval_of(self.plan, status) + 1 >= knot:
            return "too late, the robot is past the way to its first stance"
        try:
            self.link.upload(part)
        except (UsageError, WorkFailed) as refused:
            return str(refused)
        self.plan = joined(self.plan, part)
        return ""

    def as_json(self) -> dict[str, Any]:
        """What `--json` prints of it."""
        seconds = [each.seconds for each in self.made]
        return {
            "made": len(self.made),
            "kept": sum(each.kept for each in self.made),
            "median_s": statistics.median(seconds) if seconds else None,
            "each": [asdict(each) for each in self.made],
        }


def _climbs(status: status_t) -> bool:
    state = status.state
    return bool(state.supervisor_state == robot_state_t.CLIMBING and state.motion == robot_state_t.FORWARD)
