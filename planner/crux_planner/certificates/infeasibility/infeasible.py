"""Why no plan exists, if that can be shown: the goal out of reach, no equilibrium there, or no way between.

The way is looked for in the graph of `connection`, of all sets of grips that the relaxed P1 of `relaxed` allows.
"""

import itertools
from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES, N_LIMBS
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.certificates.infeasibility.connection import AIR, Connection, Grips, clashes, largest_gap
from crux_planner.certificates.infeasibility.goal_map import GoalMap
from crux_planner.certificates.infeasibility.poses import GoalPoses
from crux_planner.certificates.infeasibility.relaxed import RelaxedBalance, RelaxedReach, near_goal
from crux_planner.errors import InfeasibleError, LevelGoalError
from crux_planner.model.offers import all_grips
from crux_planner.model.poses import out_of_reach, point_text
from crux_planner.model.problem import Problem
from crux_planner.model.shapes import palm_shape
from crux_planner.solvers import clock

_WAY_POINTS = 100  # looked at between start and goal
_TURN_RAD = float(np.radians(10.0))  # of a body that more or less heads for where it goes


class Proof:
    """What can be shown about one problem. `places` are where a limb and its goal hold stand, for the reasons."""

    def __init__(self, scenario: Scenario, robot: Robot, problem: Problem) -> None:
        self.problem = problem = replace(problem, boxes=problem.limb_reach.outer)
        grips = all_grips(scenario, robot, problem.heading_rad)
        self.number = {(g.contact.hold, g.contact.pair): i for i, g in enumerate(grips)}
        self.hold = [g.contact.hold for g in grips]
        self.goal_poses = GoalPoses(near_goal(problem))
        self.goal_map = GoalMap(problem, robot, grips)
        wrists = [grip.raised(problem.boxes.above_m) for grip in grips]
        self.reach, self.equilibrium = RelaxedReach(problem, wrists), RelaxedBalance(problem, grips)
        contacts = [problem.contacts[c] for c in problem.start_contacts]
        self.start: Grips = tuple(self.number[c.hold, c.pair] for c in contacts)
        self._narrowed = False  # `goals` are those in reach of one body pose
        self.step_m = problem.body.max_speed_m_s * problem.dt_s
        hold, self.palm = np.array(self.hold), palm_shape(robot)
        self.grips = grips
        self.apart = ~clashes(grips, self.palm) & (hold[:, None] != hold)
        self.connection = Connection(self.reach, self.equilibrium, self.apart, self.step_m)

    def quick(self, held: bool = False, deadline: float = np.inf) -> InfeasibleError | None:
        """What needs no search: the goal's body pose against the reach of every stance there. `held`: a body at the
        goal is known to hold one, so which others it does not is left for `disconnected`.
        """
        problem = self.problem
        ends = []
        for limb, name in enumerate(LIMB_NAMES):
            wanted = problem.goal.grasps.get(limb)
            usable = [i for key, i in self.number.items() if wanted in (None, key)]
            if not usable:
                return InfeasibleError("reach", f"no hold can be gripped by {name}", proven=True)
            beyond = self.reach.beyond_goal(limb)[usable]
            if beyond.min() > 0:
                nearest = int(np.argmin(beyond))
                hold = problem.hold_names[self.hold[usable[nearest]]]
                return InfeasibleError("reach", out_of_reach(problem, limb, hold, beyond[nearest]), proven=True)
            ends.append([g for g, far in zip(usable, beyond, strict=True) if far <= 0])
        if (crowded := self._crowded_start()) is not None:
            return crowded
        stances = np.array(list(itertools.product(*ends)))
        for a, b in itertools.combinations(range(4), 2):
            stances = stances[self.apart[stances[:, a], stances[:, b]]]
        if len(stances):
            stances = stances[self.reach.at_goal(stances)]
        self.goals: list[Grips] = list(map(tuple, stances.tolist()))
        return None if held and self.goals else self._no_goal(deadline)

    def _no_goal(self, deadline: float) -> InfeasibleError | None:
        """Leaves out of `goals` what no body there has in reach at once; why all are, where they are."""
        problem, self._narrowed = self.problem, True
        near, self.goals = self.goals, self.goal_poses.possible(self.goals, self.reach.grips)
        if not self.goals:
            goal = point_text(problem, problem.goal.body.position_m)
            text = f"no pose of the body at the goal {goal} has a hold of its own within reach of every limb"
            if near:
                text += f" at once: short by {1000 * self.goal_poses.shortage(near, self.reach.grips):.1f} mm"
            return InfeasibleError("reach", text, proven=True)
        near, self.goals = self.goals, self.goal_map.possible(self.goals)
        if self.goals:
            near, self.goals = self.goals, self.goal_map.possible_closely(self.goals, self.goal_poses)
        if not self.goals:
            stuck = [LIMB_NAMES[limb] for limb in self.goal_map.stuck(near)]
            return self._blocked(f"{' and '.join(stuck)} hold" if stuck else "all limbs hold at once", "in the trunk")
        if not self.goal_map.at_once(self.goals, self.goal_poses, deadline):
            return self._blocked("all limbs hold at once", "in the trunk or in those of other limbs")
        return None

    def _blocked(self, who: str, inside: str) -> InfeasibleError:
        """No body pose at the goal has the limbs on any stance within joint limits and links off these."""
        at = point_text(self.problem, self.problem.goal.body.position_m)
        text = f"no pose of the body at the goal {at} lets {who}: joint limits, or links that would be {inside}"
        return InfeasibleError("reach", text, proven=True)

    def goal_equilibrium(self, programs: int, deadline: float) -> InfeasibleError | None:
        """No stance at the goal in equilibrium, with all limbs or some in the air the knot before."""
        goal, least, nearest = self.problem.goal.body.position_m, np.inf, self.goals[0]
        slack = self.problem.goal.tolerance_m + self.step_m  # the last forces are those of the knot before
        borne = (held for stance in self.goals for held in itertools.product(*[(grip, AIR) for grip in stance]))
        seen: set[Grips] = set()
        for held in borne:
            if held in seen or held.count(AIR) == len(held):
                continue
            seen.add(held)
            programs -= 1
            if programs < 0 or clock.now() > deadline:
                return None
            lacking = self.equilibrium.missing_at_goal(held, goal - slack, goal + slack)
            if lacking <= 0.0:
                return None
            if lacking < least:
                least, nearest = lacking, held
        text = f"no equilibrium at the goal, best on {self._text(nearest)}: short by {least:.1f} N"
        return InfeasibleError("equilibrium", text, proven=True)

    def disconnected(self, programs: int, deadline: float) -> InfeasibleError | None:
        """The start's part of the graph lacks the goal, or the goal's the start; None: `Connection.separated`."""
        if not self._narrowed and (none := self._no_goal(deadline)) is not None:
            return none
        part = self.connection.separated(self.start, self.goals, programs, deadline)
        return None if part is None else self._closed(set(part.headings), part.forward)

    def instead_of(self, reason: InfeasibleError) -> InfeasibleError:
        """The reason to give where a level body's is about the goal, which other bodies have in reach (see `quick`)."""
        if not isinstance(reason, LevelGoalError):
            return reason
        for most_turn_rad, turned in ((np.inf, ""), (_TURN_RAD, f" and turned by up to {np.degrees(_TURN_RAD):.0f}°")):
            if (gap := self._gap(most_turn_rad)) is not None:
                return InfeasibleError("reach", gap + turned)
        return InfeasibleError(reason.constraint, f"{reason}{reason.others}")

    def _gap(self, most_turn_rad: float) -> str | None:
        """Where on the straight way to the goal the limb that lacks most reach has nothing in reach; None: nowhere."""
        way = np.linspace(self.problem.start.position_m, self.problem.goal.body.position_m, _WAY_POINTS)
        gaps = np.array([~self.reach.in_reach(limb, way, most_turn_rad) for limb in range(N_LIMBS)])
        size, begin = gaps.sum(axis=1), gaps.argmax(axis=1)
        if not gaps.any():
            return None
        limb = int(np.argmin(np.where(size >= size.max() - 1, begin, _WAY_POINTS)))
        first = int(begin[limb])
        last = first + int(np.argmin([*gaps[limb][first:], False])) - 1
        span = " and ".join(point_text(self.problem, way[i]) for i in (first, last))
        return f"no hold within reach of {LIMB_NAMES[limb]} for a body between {span}"

    def _closed(self, part: set[Grips], from_start: bool) -> InfeasibleError:
        """The reason, from the part of the graph that has no way out."""
        full = [grips for grips in part if AIR not in grips]
        stance, lacking, limb = self._hardest_lift(full)
        others = self._text(stance, without=limb)
        where = "from the start" if from_start else "from the goal back"
        if len(full) <= 1 and 0.0 < lacking < np.inf:
            text = (
                f"no equilibrium when any limb lifts off; {LIMB_NAMES[limb]} lacks least, with the others on {others}: "
                f"short by {lacking:.1f} N at the full limit surface"
            )
            return InfeasibleError("equilibrium", text, proven=True)
        text = f"{where} only {len(full)} stances can be had, and none of them leads on: "
        stuck = self._stuck_limb(full, from_start)
        return InfeasibleError("reach", text + stuck, proven=True)

    def _hardest_lift(self, stances: list[Grips]) -> tuple[Grips, float, int]:
        best = (stances[0], np.inf, 0)
        for stance in stances[:20]:
            region = self.reach.hull(stance)
            if region is None:
                continue
            for limb in range(4):
                support = tuple(g for i, g in enumerate(stance) if i != limb)
                lacking = self.equilibrium.missing_force(support, region[0] - self.step_m, region[1] + self.step_m)
                if lacking < best[1]:
                    best = (stance, lacking, limb)
        return best

    def _stuck_limb(self, stances: list[Grips], from_start: bool) -> str:
        """The limb that in none of the stances stands on what the other end needs."""
        ends = self.goals if from_start else [self.start]
        for limb, name in enumerate(LIMB_NAMES):
            has = {self.hold[s[limb]] for s in stances}
            needs = {self.hold[s[limb]] for s in ends}
            if not has & needs:
                names = self.problem.hold_names
                place = ", ".join(sorted(names[h] for h in needs)[:3])
                return f"{name} gets to {', '.join(sorted(names[h] for h in has)[:6])}, but not to {place}"
        return "no two of their holds can be exchanged in equilibrium and within reach"

    def _crowded_start(self) -> InfeasibleError | None:
        """Two of the start's grippers that would be in each other."""
        for a, b in itertools.combinations(range(4), 2):
            one, other = self.start[a], self.start[b]
            if self.apart[one, other] or self.palm is None:
                continue
            gap = largest_gap(self.grips[one], self.grips[other], self.palm)
            on = [f"{LIMB_NAMES[i]} on {self.problem.hold_names[self.hold[g]]}" for i, g in ((a, one), (b, other))]
            keep = f"the palms of {on[0]} and {on[1]} keep {1000 * gap:.1f} mm apart at most"
            text = f"start.grasps: {keep}, 3 mm are needed"
            return InfeasibleError("clearance", text, proven=True)
        return None

    def _text(self, stance: Grips, without: int | None = None) -> str:
        names = self.problem.hold_names
        held = ((i, g) for i, g in enumerate(stance) if i != without and g != AIR)
        return ", ".join(f"{LIMB_NAMES[i]} {names[self.hold[g]]}" for i, g in held)
