"""Planning again from the middle of a route, quickly: everything that does not depend on the start is kept.

A `Planner` keeps the problem in numbers, the oracles of the search with all they have answered (balance, reach, ways)
and the compiled equations. A plan made again starts at rest on a stance of the old one, and goes to the same goal.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from crux_contracts.robot import Robot, robot_of
from crux_contracts.scenario import BodyPose, Scenario, parse_scenario
from crux_msgs import plan_t

from crux_planner.errors import InfeasibleError, no_footholds
from crux_planner.model.build import build_problem, start_contacts, start_inertia
from crux_planner.model.poses import check_body, pose_in_heading_frame
from crux_planner.model.problem import Pose, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.pipeline.at_once import plan_at_once
from crux_planner.pipeline.attempt import attempts
from crux_planner.pipeline.by_joints import UNLIMITED
from crux_planner.pipeline.by_map import Tried, plan_by_map
from crux_planner.pipeline.explanation import explain
from crux_planner.pipeline.fallback import ATTEMPTS, without_blamed
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.moved_holds import on_moved_holds
from crux_planner.pipeline.pace import paced
from crux_planner.pipeline.remaining_plan import RemainingPlan, read_remaining
from crux_planner.pipeline.restart import rewritten, scenario_at, stance_knot
from crux_planner.pipeline.session import Session, Work
from crux_planner.pipeline.solve_and_check import SPARE_KNOTS, Climb, finish, in_time, path_to_goal
from crux_planner.reach.arm import reaches_of
from crux_planner.search.stances import ANY, Oracles, SearchReport, search
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers import clock
from crux_planner.trajectory.joint_rows import JointFunctions
from crux_planner.trajectory.solution import Start, start_from_path

TIME_LIMIT_S = 10.0
FIRST_LOOK = (20.0, 1.0)  # stances, and more a knot: ways of a level body that are not found so soon are searched last
_SLACK_M = 1e-3


class Planner:
    """Plans again and again on one wall, towards one goal."""

    def __init__(self, scenario: Scenario | Mapping[str, object], robot: Robot | str | Path) -> None:
        """Takes scenarios and robots, and raises ScenarioError, RobotError, InfeasibleError, as `crux_planner.plan`."""
        self.scenario = scenario if isinstance(scenario, Scenario) else parse_scenario(scenario)
        self.robot = robot_of(robot)
        self.problem = build_problem(self.scenario, self.robot)
        self.oracles = Oracles.of(self.problem, TorqueLimits(self.problem, self.problem.friction_share))
        self.functions = JointFunctions(self.problem, reaches_of(self.robot), UNLIMITED)
        self._refused: InfeasibleError | None = None
        self._seen = SearchReport()

    def replan(
        self,
        running: plan_t,
        at_s: float,
        *,
        body: BodyPose | None = None,
        without: Collection[str] = (),
        quick: bool = False,
        time_limit_s: float = TIME_LIMIT_S,
        log: Callable[[str], None] | None = None,
    ) -> PlanResult:
        """A checked plan from the stance that `running`, a plan of this wall, takes next at or after `at_s`.

        The wall may have its holds elsewhere than `running`, whose grips then go with them: a map that was measured.

        `body` is where the body is meanwhile, if not where that plan has it; the holds in `without` are no holds any
        more, but still in the way. The plan takes the steps the running one has left, or what the way takes if that is
        more; ways are searched within what the scenario's horizon has left. `timing` has
        stance, contacts, body, nlp and message, which are the planning, and the check. The running plan's own moves
        are tried first, then others that lead back to them, then other headings and grasps (without a bound of the
        cost); where all that finds nothing `plan` is asked, which also says why. `quick`: only the running plan's own
        moves, and others that lead back to them.
        Raises InfeasibleError, and ScenarioError for a name in `without` that is no hold's, a body outside (7) and
        footholds.
        """
        no_footholds(self.scenario, "planning again is")
        work = Work(lambda _what, _share: None, log or (lambda _line: None))
        with work.part("stance", 0.0):
            deadline = clock.now() + time_limit_s
            running = on_moved_holds(running, self.scenario)
            first = stance_knot(running, at_s)
            scenario = scenario_at(self.scenario, running, first, body, without)
            problem = self._from(scenario, without)
            if body is not None:
                check_body(scenario, problem.body, problem.start, problem.goal.body)
            remaining = read_remaining(problem, running, first)
        session = Session(scenario, self.robot, work, deadline, time_limit_s, "auto")
        climb = Climb(session, replace(self.oracles, problem=problem))
        result = None
        if remaining is not None and remaining.open_to(problem):
            begun = remaining.begun_at_rest(problem)  # the running plan's own moves
            timed = climb.of(replace(problem.aimed(), steps=begun.steps))
            result = self._finish(timed, begun.schedule, begun.start)
        most = max(problem.steps, self.scenario.horizon.steps - first)
        result = result or self._anew(climb, most, remaining)
        if result is None and quick:
            failure = self._refused or explain(climb.oracles, self._seen, most)
            raise failure.out_of_time() if session.late else failure
        result = result or self._by_map(climb, most)
        if result is None:
            work.log("the quick ways found no plan that passes the check; planning from scratch")
            left = max(scenario.horizon.steps, self.scenario.horizon.steps - first)
            scenario = rewritten(scenario, steps=left)
            return plan_at_once(scenario, self.robot, time_limit_s=max(deadline - clock.now(), 1.0), log=log)
        result = paced(result, scenario, self.robot, work)
        result.seconds, result.computed_s = work.took_s()
        return result

    def plan(
        self, *, time_limit_s: float = TIME_LIMIT_S, method: str = "auto", log: Callable[[str], None] | None = None
    ) -> PlanResult:
        """A checked plan from the scenario's start, limbs in the air or not: the quickest moves, no bound of the cost.

        `method`: what the plan says of how it came about. Raises InfeasibleError.
        """
        work = Work(lambda _what, _share: None, log or (lambda _line: None))
        session = Session(self.scenario, self.robot, work, clock.now() + time_limit_s, time_limit_s, method)
        climb = Climb(session, self.oracles).of(replace(self.problem, steps=1))
        most, failures = self.scenario.horizon.steps, list[InfeasibleError]()

        def level(stances: tuple[float, float]) -> PlanResult | None:
            def attempt(climb: Climb) -> PlanResult | InfeasibleError | None:
                return self._anew(climb, most, None, stances) or self._refused

            until = session.deadline
            found, _ = attempts(climb, attempt, (without_blamed,), failures, most=ATTEMPTS, until=until)
            climb.oracles.swings.allow_all()
            return found

        result = level(FIRST_LOOK)
        cut_short = self._seen.timed_out
        result = result or self._by_map(climb, most)
        if result is None and cut_short and not climb.session.late:
            result = level(ANY)
        if result is None:
            failure = failures[0] if failures else explain(climb.oracles, self._seen, 1)
            raise failure.out_of_time() if climb.session.late else failure
        result = paced(result, self.scenario, self.robot, work)
        result.seconds, result.computed_s = work.took_s()
        return result

    def _by_map(self, climb: Climb, most: int) -> PlanResult | None:
        """With other headings and grasps, in up to `most` steps."""
        scenario = rewritten(climb.session.scenario, steps=most)
        problem = build_problem(scenario, self.robot, reach=self.problem.limb_reach)
        found = plan_by_map(replace(_for(climb, scenario), oracles=Oracles.of(problem)), Tried())
        return None if found is None else found[0]

    def _anew(
        self, climb: Climb, most: int, remaining: RemainingPlan | None, stances: tuple[float, float] = ANY
    ) -> PlanResult | None:
        """The quickest moves to where the running plan's are known to lead on, or to the goal; up to `most` steps.

        The search gives up after so many `stances`, as search's `most`.
        """
        known = None if remaining is None else remaining.known(climb.problem)
        self._refused = None
        with climb.work.part("contacts", 0.1):
            longer, until = climb.of(replace(climb.problem, steps=most)), climb.session.deadline
            found = search(longer.oracles, at_once=1, greed=1.0, deadline=until, most=stances, known=known)
            moves, self._seen = found
        for spare in SPARE_KNOTS if moves is not None else ():
            with climb.work.part("body", 0.3):
                timed, schedule = in_time(climb, moves or [], spare)
                aimed, path = path_to_goal(self._as_level(timed.problem), climb.oracles.equilibrium, schedule)
                timed = timed.of(replace(timed.problem, goal=aimed.goal))
            if path is not None:
                result = self._finish(timed, schedule, start_from_path(timed.problem, path))
                if result is not None:
                    return result
        return None

    def _finish(self, climb: Climb, schedule: Schedule, start: Start) -> PlanResult | None:
        scenario = rewritten(climb.session.scenario, steps=climb.problem.steps)
        problem = self._as_numbered_in(scenario, climb.problem)
        found = finish(_for(climb, scenario).of(problem), schedule, start, self.functions)
        if isinstance(found, PlanResult):
            return found
        climb.work.log(f"refused: {found}")
        self._refused = found
        return None

    def _from(self, scenario: Scenario, without: Collection[str]) -> Problem:
        """The problem with another start, in the same frame and with the same contacts, less those on some holds."""
        problem = self.problem
        start = pose_in_heading_frame(scenario.start.body, problem.heading_rad)
        contacts = self._as_numbered_in(scenario, problem).contacts
        begin = start_contacts(scenario, self.robot, start, contacts, {}, (-np.inf, np.inf))
        lost = {self.scenario.hold_index(name) for name in without}
        yaw = abs(float(start.rpy_rad[2]))  # speeds are bounded along axes of the first pose, not of this frame
        speed = problem.body.max_speed_m_s / (math.cos(yaw) + math.sin(yaw))
        return replace(
            problem,
            start=start,
            body=replace(problem.body, max_speed_m_s=speed),
            start_contacts=(begin[0], begin[1], begin[2], begin[3]),
            limb_contacts=[
                [c for c in usable if problem.contacts[c].hold not in lost] for usable in problem.limb_contacts
            ],
            steps=scenario.horizon.steps,
            inertia_b=start_inertia(self.robot, start, [problem.contacts[c] for c in begin]),
        )

    def _as_numbered_in(self, scenario: Scenario, problem: Problem) -> Problem:
        """The problem with its holds' numbers in a scenario where some have become obstacles."""
        if len(scenario.holds) == len(self.scenario.holds):
            return problem
        numbers = {cuboid.name: i for i, cuboid in enumerate(scenario.cuboids)}
        contacts = [replace(c, hold=numbers[problem.hold_names[c.hold]]) for c in problem.contacts]
        return replace(problem, contacts=contacts)

    def _as_level(self, problem: Problem) -> Problem:
        """The problem as the path of a level body sees it: how the robot is tilted is left to the exact program."""
        bounds, position = self.oracles.reachable.of(problem.start_contacts), problem.start.position_m
        if bounds is not None:  # into these, with a little space where there is some
            low, high = bounds[0][:3], bounds[1][:3]
            slack = np.minimum(_SLACK_M, (high - low) / 2)
            position = np.clip(position, low + slack, high - slack)
        return replace(problem, start=Pose(position, np.zeros(3)))


def _for(climb: Climb, scenario: Scenario) -> Climb:
    """The same climb of another scenario."""
    return replace(climb, session=replace(climb.session, scenario=scenario))
