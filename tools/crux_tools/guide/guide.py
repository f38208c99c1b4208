"""Beside a runtime: where the robot holds for a cause that another plan may avoid, plans from there and goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from itertools import pairwise

from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_msgs import command_t, limb_knot_t, plan_t, robot_state_t, status_t
from crux_planner import InfeasibleError, Planner, PlanResult

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.guide.situation import Situation, refuse_feet
from crux_tools.operator_link import START_IT, OperatorLink
from crux_tools.operator_status import fault_of, hanging, is_only_told
from crux_tools.telemetry.summary import STANDS_UP

REPLANNED = (
    "event_timeout",
    "body_error",
    "tracking_error",
    "grip_lost",
    "ik_failed",
    "ft_implausible",
    "grasp_failed",
    "slip",
    "stance_misfit",
    "finger_force_implausible",
    "hold_missing",
    "power_lost",
)
"""Faults after which another plan may lead on: a hold lost, moved or slippery, the body elsewhere, a limb weak, or
nodes that have power again."""
SETTLED_S = 0.3  # of standing, before what is measured counts
RETURNED_S = 7.0  # where a limb may be on its way to a hold: longer than the runtime waits for it
PLANNING_S = 20.0  # of computing, for the way to one goal
TRIES = 5
RESTART_S = 60.0  # for a runtime that answered before to answer again
RESTARTED = "restarted"  # the fault that tells it
SAFE_STANCES = 3  # behind the robot, to which a way is looked for


class Attended(Enum):
    """What became of a look at the runtime."""

    NOTHING = "nothing to do"
    WAITING = "the robot is about to hold"
    STARTED = "another plan is climbed"
    RESUMED = "the plan is climbed on, after a restart of the runtime"
    DONE = "the robot is at the goal"
    OPERATOR = "an operator has to clear the fault"
    GAVE_UP = "no plan leads on"


@dataclass
class Guide:
    """One robot's guide. `plan` is what the runtime climbs; `say` hears every decision and its reason."""

    link: OperatorLink
    plan: plan_t
    robot: Robot
    say: Callable[[str], None]
    tries: int = TRIES
    agrees: Callable[[], bool] = lambda: True
    """asked before another plan is uploaded"""
    climbs_down: bool = field(default=False, init=False)
    """the last plan leads to a safe stance, not to the goal"""
    tried: int = field(default=0, init=False)
    planning_s: float = field(default=0.0, init=False)
    """what the last plan took to make"""
    _still: tuple[float, float] | None = field(default=None, init=False)  # plan time at which it stands, and since when
    _reason: str = field(default="", init=False)  # why the last plan was made
    _gave_up: bool = field(default=False, init=False)
    _missed: set[str] = field(default_factory=set, init=False)  # holds that a limb did not grip
    _awaited: str = field(default="", init=False)  # the fault that an operator has to clear
    _held: bool = field(default=False, init=False)  # by an operator
    _heard_s: float | None = field(default=None, init=False)  # when the runtime answered last

    def __post_init__(self) -> None:
        refuse_feet(self.plan)
        # Everything that planning needs is loaded before it is needed.
        Planner(parse_scenario(self.plan.scenario_yaml), self.robot)

    def attend(self) -> Attended:
        """Looks at the runtime, and does what there is to do. Raises WorkFailed where nobody answers."""
        answer = self.link.command(command_t.STATUS)
        if answer is None:
            return self._nobody()
        plan_id, status = answer.plan_id, self.link.status
        if self._heard_s is not None and self._heard_s < 0.0:
            self.say("the runtime answers again")
        self._heard_s = time.monotonic()
        if status is None or status.state.supervisor_state != robot_state_t.HOLDING:
            self._still, self._awaited = None, ""
            if status is not None and status.state.supervisor_state == robot_state_t.CLIMBING:
                self._held = False
            return Attended.NOTHING
        fault = fault_of(status)
        if fault is None or is_only_told(fault):
            if status.state.plan_complete and not self.climbs_down:
                return Attended.DONE
            if fault is not None and fault["name"] == RESTARTED and not self._held and plan_id == self.plan.plan_id:
                return self._resume(status)
            self._held = self._held or fault is None
            return Attended.NOTHING
        if self._gave_up:
            return Attended.GAVE_UP
        if self._awaited == fault["name"]:
            return Attended.OPERATOR
        if not self._stands(status):
            return Attended.WAITING
        self.say(f"holds: {fault['where']}{fault['text']}")
        if plan_id != self.plan.plan_id:
            return self._give_up(f"the runtime climbs plan {plan_id[:12]}, not {self.plan.plan_id[:12]}")
        if fault["name"] not in REPLANNED:
            self._awaited = fault["name"]
            self.say(f"another plan does not help; waiting until an operator clears it: {fault['do']}")
            return Attended.OPERATOR
        situation = Situation(self.plan, status, self.robot, frozenset(self._missed))
        if (missed := situation.missed()) is not None:
            self._missed.add(missed)
        return self._lead_on(situation)

    def _nobody(self) -> Attended:
        """Nobody answers. Raises WorkFailed where nobody ever has, or not for long."""
        if self._heard_s is None or time.monotonic() - abs(self._heard_s) > RESTART_S:
            raise WorkFailed(f"no runtime answers on {self.link.url}; {START_IT}")
        if self._heard_s > 0.0:
            self.say("the runtime does not answer any more; waiting until it does")
            self._heard_s = -self._heard_s
        return Attended.NOTHING

    def _resume(self, status: status_t) -> Attended:
        if not self._stands(status):
            return Attended.WAITING  # until its nodes have been re-armed
        try:
            self.link.send(command_t.RESUME)
        except (UsageError, WorkFailed) as refused:
            self.say(str(refused))
            return Attended.WAITING
        self.say(f"the runtime has restarted: {hanging(status)}; goes on with the plan")
        return Attended.RESUMED

    def _stands(self, status: status_t) -> bool:
        """It has stood for a while; a limb may first go back to its hold, or on to the next, by itself."""
        state = status.state
        if state.waiting_for == STANDS_UP:
            return False
        if self._still is None or self._still[0] != state.plan_time_s:
            self._still = (state.plan_time_s, state.time_s)
        settled_s = SETTLED_S if state.motion == robot_state_t.FORWARD else RETURNED_S
        return bool(state.time_s - self._still[1] >= settled_s)

    def _lead_on(self, situation: Situation) -> Attended:
        no_further = situation.interval == 0 and not situation.useless()
        if no_further and situation.reason == self._reason:
            return self._give_up("the last plan came no further than its beginning, for the same reason")
        self._reason = situation.reason
        if self.tried == self.tries:
            return self._give_up(f"{self.tries} plans have not led on")
        self.tried += 1
        result = self._way(situation)
        if result is None:
            return self._give_up("the robot stays where it is")
        for line in told(result.plan):
            self.say(line)
        if not self.agrees():
            return self._give_up("the operator does not want it")
        try:
            self.link.upload(result.plan)
            self.plan = result.plan
            self.link.send(command_t.START, result.plan.plan_id)
        except (UsageError, WorkFailed) as refused:
            self.say(str(refused))
            return Attended.WAITING
        self._still = None
        return Attended.STARTED

    def _way(self, situation: Situation) -> PlanResult | None:
        """On to the goal, else back to a safe stance."""
        for name in sorted(situation.useless()):
            self.say(f"{name} is no hold any more")
        goals = [None] if not self.climbs_down else []
        for goal in [*goals, *situation.safe_goals()[:SAFE_STANCES]]:
            where = "to the goal" if goal is None else "back to a safe stance"
            if goal is None and (wanted := situation.wanted_in_vain()):
                self.say(f"no way {where}: it asks for {' and '.join(wanted)}")
                continue
            try:
                planner = Planner(situation.scenario(goal), self.robot)
                result = planner.plan(time_limit_s=PLANNING_S, method=f"guide: {situation.reason}")
            except (InfeasibleError, ScenarioError) as none:
                self.say(f"no way {where}: {none}")
                continue
            self.climbs_down = goal is not None
            self.planning_s = result.seconds
            self.say(f"{where} in {result.plan.knots[-1].time_s:g} s, planned in {result.seconds:.1f} s")
            return result
        return None

    def _give_up(self, reason: str) -> Attended:
        self.say(reason)
        self._gave_up = True
        return Attended.GAVE_UP


def told(plan: plan_t) -> list[str]:
    """What a plan does, move by move."""
    lines = []
    for before, after in pairwise(plan.knots):
        for limb, name in enumerate(LIMB_NAMES):
            if before.limbs[limb].phase == limb_knot_t.AIR and after.limbs[limb].phase == limb_knot_t.STANCE:
                lines.append(f"  {after.time_s:5.0f} s  {name} to {plan.holds[after.limbs[limb].hold].name}")
    return [*lines, f"  {plan.knots[-1].time_s:5.0f} s  the end"]
