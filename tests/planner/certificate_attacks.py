"""A search for a plan that costs less than a certificate says any can: all that `crux check` accepts counts.

The scenes are small and drawn at random: weights, margins, slope, tilts, friction, spines, goal tolerances, length of a
step, waits and uncertainty. An attack plans the same scene with other settings of the planner, which `crux check` does
not know: without margins, with all of the inner reach, with grasps elsewhere on their faces, with other schedules over
as many steps (waits, or limbs longer in the air), then with higher and wider swings. J is the scene's, as the checker
counts it.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.cost_weights import CLIMB
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, ScenarioError
from crux_planner import InfeasibleError
from crux_planner.checker import check_plan
from crux_planner.checker.certificate import verify
from crux_planner.checker.cost import cost
from crux_planner.checker.no_way import NotShownError
from crux_planner.checker.plan_arrays import read_plan
from crux_planner.checker.report import Findings
from crux_planner.model.build import build_problem
from crux_planner.model.contacts import Contact
from crux_planner.model.offers import all_grips
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule
from crux_planner.pipeline.bound_certificate import certify_bound
from crux_planner.pipeline.message import plan_message
from crux_planner.pipeline.session import Session, Work
from crux_planner.pipeline.solve_and_check import Climb, in_time, path_to_goal
from crux_planner.search.stances import Oracles, search
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers import clock
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.solution import Start, start_from_path
from crux_planner.trajectory.stage_functions import StageFunctions
from walls import FEET, hold, scenario

ROBOT = load_robot("scaler")
HORIZON, SPARE = 20, 5  # steps to plan in; the certificate is about up to so many more than the plan takes, less one
NO_MARGINS = {"friction": 0.0, "torque": 0.0, "clearance_m": 0.012}
STANCES = (60.0, 4.0)  # looked at by the search
VERIFIED = 10  # of so many certificates one is verified as `crux check` does
PLACES = 2  # of the grasps, drawn
RAISED_M, OPENED_M = (0.03, 0.01, 0.003), 0.004  # tried on swings


@dataclass(frozen=True)
class Certified:
    """A scene, the number of steps and the bound of its certificate, and the cheapest plan found."""

    wall: dict[str, Any]
    steps: int
    bound: float
    cheapest: float
    accepted: int  # plans


def drawn_wall(seed: int) -> dict[str, Any]:
    """A scene of up to two moves: its start's four holds, and one for each limb that moves."""
    random = np.random.default_rng(seed)

    def maybe(share: float) -> bool:
        return bool(random.random() < share)

    def between(low: float, high: float) -> float:
        return round(float(random.uniform(low, high)), 4)

    def some(name: str, x: float, y: float) -> dict[str, Any]:
        friction: Any = between(0.9, 2.5)
        if maybe(0.3):
            friction = {face: between(0.9, 2.5) for face in ("+x", "-x", "+y", "-y", "top")}
        place = round(x + between(-0.02, 0.02), 4), round(y + between(-0.02, 0.02), 4)
        return hold(name, *place, yaw_deg=between(-8, 8)) | {"friction": friction}

    still = maybe(0.3)  # the body stays where it is: the bound is tightest there
    limbs = [str(limb) for limb in random.permutation(LIMB_NAMES)[: 0 if still else random.integers(0, 3)]]
    holds = [some(f"{limb}-low", *FEET[limb]) for limb in LIMB_NAMES]
    holds += [some(f"{limb}-high", FEET[limb][0] + between(0.13, 0.17), FEET[limb][1]) for limb in limbs]
    grasps = {limb: {"hold": f"{limb}-low", "faces": "x"} for limb in LIMB_NAMES}
    tilt = [[between(-3, 3), between(-3, 3), between(-4, 4)] for _ in range(2)]
    ahead = [between(-0.01, 0.02) + 0.015 * len(limbs), between(-0.01, 0.01), 0.185 + between(-0.005, 0.005)]
    if still:
        ahead = [0.0, 0.0, 0.185]
    goal: dict[str, Any] = {"position_m": ahead, "rpy_deg": tilt[0] if still or maybe(0.5) else tilt[1]}
    goal |= {"tolerance_m": between(0.001, 0.02), "tolerance_deg": between(0.2, 4.0)}
    usual = {**vars(CLIMB), "body": 1.0}
    weights = {name: usual[name] * float(10 ** random.uniform(-2, 1.5)) for name in usual if maybe(0.35)}
    most = {"friction": 0.3, "torque": 0.3, "clearance_m": 0.03}
    margins = {name: between(0.0, high) for name, high in most.items() if maybe(0.4)}
    wall: dict[str, Any] = {
        "version": 1,
        "name": f"drawn-{seed}",
        "robot": "scaler",
        "wall": {"slope_deg": round(90.0 * float(random.random()) ** 1.3, 2)},
        "contact": {
            "model": "patch", "patch_radius_m": between(0.012, 0.022), "max_normal_N": between(35, 60),
            "spine_shear_N": between(0, 8), "spine_twist_Nm": between(0, 0.08),
        },
        "holds": holds,
        "start": {"body": {"position_m": [0.0, 0.0, 0.185], "rpy_deg": tilt[0]}, "grasps": grasps},
        "goal": {"body": goal, "grasps": {limb: {"hold": f"{limb}-high", "faces": "x"} for limb in limbs}},
        "horizon": {"steps": HORIZON, "dt_s": between(1.5, 3.5)},
        "planner": {"weights": weights, "margins": margins},
    }  # fmt: skip
    if maybe(0.2):
        known = {"friction": between(0, 0.15), "hold_position_m": between(0, 0.002), "mass_kg": between(0, 0.3)}
        wall["uncertainty"] = known
    if maybe(0.3):
        wall["planner"]["idle"] = "keep"
    return wall


def attacked(seed: int) -> Certified | None:
    """A drawn scene's certificate and the cheapest plan found; None where the scene has no plan or no certificate."""
    wall, random = drawn_wall(seed), np.random.default_rng(seed + 1)
    try:
        begun = Attack(scenario(wall)).begun()
    except (ScenarioError, InfeasibleError):
        return None
    if begun is None:
        return None
    steps = len(begun[1].contacts) - 1 + int(random.integers(0, SPARE))
    if wall["planner"].get("idle") == "keep":
        wall["horizon"]["steps"] = steps
    read = scenario(wall)
    attack = Attack(read)
    attack.run(steps, begun)
    if not attack.accepted:
        return None
    first = attack.cheapest
    bare = scenario({**wall, "planner": {**wall["planner"], "margins": NO_MARGINS}})
    for moved in (None, *random.spawn(PLACES)):
        attack.again(steps, bare, moved)
    attack.raise_swings()
    try:
        document = certify_bound(read, ROBOT, steps, first)
    except NotShownError:
        return None
    if seed % VERIFIED == 0:
        verify(document)
    return Certified(wall, steps, document["bound"], attack.cheapest, attack.accepted)


class Attack:
    """On one scene; `cheapest` is J of the cheapest plan that was accepted."""

    def __init__(self, read: Scenario) -> None:
        self.read, self.cheapest, self.accepted, self._best = read, np.inf, 0, None
        self._session = Session(read, ROBOT, Work(lambda *_: None, lambda _line: None), clock.now() + 60, 60, "auto")

    def begun(
        self, read: Scenario | None = None, moved: np.random.Generator | None = None
    ) -> tuple[Climb, Schedule, Start] | None:
        """The quickest moves over the steps that they need, planned with the settings of `read`; None: no way.

        With `moved`, grasps are not in the middle of their faces.
        """
        problem = build_problem(read or self.read, ROBOT)
        if moved is not None:
            problem = replace(problem, contacts=_elsewhere(problem, self.read, moved))
        oracles = Oracles.of(problem, TorqueLimits(problem, problem.friction_share))
        climb = Climb(self._session, oracles)
        moves, _ = search(oracles, at_once=1, greed=1.0, deadline=climb.session.deadline, most=STANCES)
        return None if moves is None else _scheduled(climb, moves)

    def again(self, steps: int, read: Scenario, moved: np.random.Generator | None) -> None:
        """Plans made with other settings of the planner, see `begun`."""
        try:
            begun = self.begun(read, moved)
        except (ScenarioError, InfeasibleError):
            return
        if begun is not None:
            self.run(steps, begun)

    def run(self, steps: int, begun: tuple[Climb, Schedule, Start]) -> None:
        """Plans of so many steps with the moves of a schedule of as many or fewer."""
        climb, schedule, start = begun
        problem = replace(climb.problem.farther(), steps=steps)
        functions = StageFunctions(problem)
        for longer in _longer(steps, schedule, start, climb.problem.dt_s):
            for tried in (problem, problem.aimed()):
                solution = solve_within_torques(tried, *longer, climb.session.deadline, functions)
                if solution.solved:
                    self.offer(plan_message(self.read, ROBOT, tried, longer[0], solution))

    def offer(self, message: Any) -> None:
        """Counts a plan if it is the cheapest so far and accepted."""
        arrays = read_plan(message, Findings())
        assert arrays is not None
        price = cost(arrays, self.read)
        if price < self.cheapest and check_plan(message, ROBOT).ok:
            self.cheapest, self._best = price, message
            self.accepted += 1

    def raise_swings(self) -> None:
        """The cheapest plan with its limbs in the air higher, and their fingers farther apart."""
        for raised_m in RAISED_M:
            for opened_m in (OPENED_M, 0.0):
                message = copy.deepcopy(self._best)
                _raise(message, raised_m, opened_m)
                self.offer(message)


def _elsewhere(problem: Problem, read: Scenario, random: np.random.Generator) -> list[Contact]:
    """The contacts anywhere along their faces, as low or as high as pads may be."""
    grips = {(g.contact.hold, g.contact.pair): g for g in all_grips(read, ROBOT, problem.heading_rad)}
    contacts = []
    for contact in problem.contacts:
        grip = grips[contact.hold, contact.pair]
        place = contact.centre_h_m + random.uniform(-1.0, 1.0) * grip.aside_m * contact.tangent
        contacts.append(replace(contact, centre_h_m=np.array([*place[:2], random.choice(grip.height_m)])))
    return contacts


def _scheduled(climb: Climb, moves: list[Move]) -> tuple[Climb, Schedule, Start] | None:
    climb = climb.of(replace(climb.problem, steps=1))
    timed, schedule = in_time(climb, moves)
    aimed, path = path_to_goal(timed.problem, climb.oracles.equilibrium, schedule)
    if path is None:
        return None
    return timed, schedule, start_from_path(aimed, path)


def _longer(steps: int, schedule: Schedule, start: Start, dt_s: float) -> Iterator[tuple[Schedule, Start]]:
    """The same over so many steps: one of its knots, all limbs on or one at its highest, comes again and again."""
    last = len(schedule.contacts) - 1
    more = steps - last
    if more <= 0:
        if more == 0:
            yield schedule, start
        return
    air = np.array([[c is None for c in knot] for knot in schedule.contacts])
    heights = np.where(air, schedule.poses[..., 2], -np.inf)
    tops = {int(heights[:, limb].argmax()) for limb in range(4) if air[:, limb].any()}
    for knot in sorted({1, last, *tops}):
        kept = np.sort(np.append(np.arange(last + 1), np.full(more, knot)))
        body = start.body[kept].copy()
        body[:-1, 6:] = np.diff(body[:, :6], axis=0) / dt_s
        wrenches = [start.wrenches[min(k, last - 1)] for k in kept[:-1]]
        contacts = [schedule.contacts[k] for k in kept]
        repeated = replace(schedule, contacts=contacts, poses=schedule.poses[kept])
        yield repeated, Start(body, wrenches, near=True)


def _raise(message: Any, raised_m: float, opened_m: float) -> None:
    """Higher and wider between the first and the last knot of every swing."""
    highest, widest = ROBOT.grasp.max_swing_height_m, 2 * ROBOT.gripper.opening_m[1]
    message.plan_id = ""
    for before, knot, after in zip(message.knots, message.knots[1:], message.knots[2:], strict=False):
        for limbs in zip(before.limbs, knot.limbs, after.limbs, strict=True):
            if all(limb.phase == limb.AIR for limb in limbs):
                x, y, z = limbs[1].gripper_position_w_m
                limbs[1].gripper_position_w_m = [x, y, min(z + raised_m, highest)]
                limbs[1].finger_separation_m = min(limbs[1].finger_separation_m + opened_m, widest)
