"""From what the runtime reports of a robot that holds to a scenario that begins there: the map as it was measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.grip_places import grasp_of
from crux_contracts.gripper_frames import yaw_and_tilt
from crux_contracts.interpolation import knot_times_s
from crux_contracts.robot import Robot
from crux_contracts.scenario import FACE_NAMES, Scenario, ScenarioError, parse_scenario
from crux_contracts.scenario_document import (
    Document,
    as_obstacle,
    change_friction,
    foot_of,
    moved,
    scenario_document,
    set_foot,
)
from crux_contracts.yaml_document import Problem
from crux_msgs import hold_t, limb_knot_t, limb_reference_t, limb_telemetry_t, plan_t, status_t

from crux_tools.errors import UsageError
from crux_tools.operator_status import GRIPPING
from crux_tools.telemetry.rotations import rotations_from_quaternions

COMING = (5, 6)  # descend, close
NOT_GRIPPED = ("event_timeout", "tracking_error", "ik_failed", "grasp_failed", "hold_missing")
"""Faults after which the hold that the limb came to is elsewhere, slippery or gone."""
FITS_M = 0.01  # grips off each other by more: the body is not where it seems
SHIFT_M, TURN_RAD = 0.005, 0.035  # that a hold is off the map at least where it is moved there
LEAST_STEPS = 60  # of the horizon: the way on may be a detour
INSIDE_M, INSIDE_RAD = 0.002, 0.01  # kept of the body's bounds (7)
IN_PLAN, MEASURED = "the scenario in the plan", "the wall as measured"  # in messages


def refuse_feet(plan: plan_t) -> None:
    """Raises UsageError for a plan in which limbs stand on footholds: a foot feels no hold, and the runtime takes over
    no other plan from there.
    """
    if plan.format == plan_t.FORMAT_FEET:
        raise UsageError(f"{plan.scenario_name}: limbs stand on footholds; such a plan is not made anew on its way")


@dataclass(frozen=True)
class Situation:
    """A robot that holds: the plan it was on, and what the runtime says of it."""

    plan: plan_t
    status: status_t
    robot: Robot
    missed_before: frozenset[str] = frozenset()
    """holds that a limb on its way to them did not grip under an earlier plan"""

    @cached_property
    def _planned(self) -> Scenario:
        return parse_scenario(self.plan.scenario_yaml, any_robot=True)

    def _grasp(self, limb: limb_knot_t) -> dict[str, Any]:
        return grasp_of(self.plan, limb, self._planned)

    @property
    def interval(self) -> int:
        """Of the plan, in which its clock stands."""
        knot = np.searchsorted(knot_times_s(self.plan), self.status.state.plan_time_s + 1e-9) - 1
        return int(np.clip(knot, 0, self.plan.n_knots - 2))

    def grips(self, limb: int) -> bool:
        """A limb that has lost its hold is given nothing to bear."""
        reference, telemetry = self.status.reference[limb], self.status.telemetry[limb]
        lost = reference.load > 0.0 and not any(telemetry.force_reference_w_n)
        return reference.phase in GRIPPING and not lost

    def grasp(self, limb: int) -> limb_knot_t:
        """What the limb grips as planned, or was to grip next."""
        knots = [knot.limbs[limb] for knot in self.plan.knots[self.interval :]]
        return next(knot for knot in knots if knot.phase == limb_knot_t.STANCE)

    def hold(self, limb: int) -> str:
        """Name of its hold."""
        return str(self.plan.holds[self.grasp(limb).hold].name)

    @property
    def fault(self) -> str:
        """Name of the one that stands."""
        return FAULT_BY_CODE[self.status.fault.code].name

    @property
    def reason(self) -> str:
        """Why the robot holds, in short."""
        limb = self.status.fault.limb
        return self.fault if limb < 0 else f"{self.fault} of {LIMB_NAMES[limb]}"

    def useless(self) -> dict[str, int]:
        """Holds that are none, and whose: those that were lost by opening and force of their fingers, and one that the
        limb on its way to it has failed to grip twice."""
        limbs = [limb for limb in range(len(LIMB_NAMES)) if self._phase(limb) in GRIPPING and not self.grips(limb)]
        missed = self.missed()
        if missed in self.missed_before:
            limbs.append(self.status.fault.limb)
        return {self.hold(limb): limb for limb in limbs}

    def missed(self) -> str | None:
        """The hold that the limb on its way to it has not gripped. The limb is one witness, and the other grips that
        fit each other the second: where one of them has moved, or an encoder has drifted, the body is elsewhere and the
        hold may be where it should."""
        limb = self.status.fault.limb
        comes = self.fault in NOT_GRIPPED and limb >= 0 and self._phase(limb) in COMING
        return self.hold(limb) if comes and self._stance_fits() else None

    def _stance_fits(self) -> bool:
        """No grip has moved against the others since contact."""
        others = [limb for limb in filter(self.grips, range(len(LIMB_NAMES))) if limb != self.status.fault.limb]
        moved_m = [np.linalg.norm(self.status.telemetry[limb].stance_shift_g_m) for limb in others]
        return bool(max(moved_m, default=0.0) <= FITS_M)

    def wanted_in_vain(self) -> list[str]:
        """What the goal asks for that is no hold any more."""
        grasps = scenario_document(self.plan.scenario_yaml, IN_PLAN)["goal"].get("grasps") or {}
        return [f"{limb} on {grasp['hold']}" for limb, grasp in grasps.items() if grasp["hold"] in self.useless()]

    def _phase(self, limb: int) -> int:
        return int(self.status.reference[limb].phase)

    def scenario(self, goal: dict[str, Any] | None = None) -> Scenario:
        """The plan's scenario from here on, to its own goal or another. Raises ScenarioError."""
        content = scenario_document(self.plan.scenario_yaml, IN_PLAN)
        self._measure(content)
        content["start"] = self._start()
        content["goal"] = goal or content["goal"]
        content["horizon"]["steps"] = max(content["horizon"]["steps"], LEAST_STEPS)
        made = parse_scenario(content, MEASURED)
        if made.tilts:
            self._upright_in_air(made)
        return made

    def _upright_in_air(self, scenario: Scenario) -> None:
        """Raises ScenarioError where a gripper in the air is not upright, as scenarios have it."""
        for name in scenario.start.air:
            telemetry = self.status.telemetry[LIMB_NAMES.index(name)]
            off_rad = float(np.linalg.norm(_yaw_and_tilt(telemetry)[1]))
            if off_rad > TURN_RAD:
                why = "a plan begins with grippers in the air upright on the wall, expected at most"
                found = f"tilted by {math.degrees(off_rad):.0f} degrees"
                problem = Problem(f"start.air.{name}", found, f"{why} {math.degrees(TURN_RAD):.0f}")
                raise ScenarioError(MEASURED, [problem])

    def safe_goals(self) -> list[dict[str, Any]]:
        """Goals on the plan's stances behind, the last first, whose holds are still holds."""
        useless, goals, seen = self.useless(), list[dict[str, Any]](), set[tuple[int, ...]]()
        for knot in reversed(self.plan.knots[: self.interval + 1]):
            held = tuple(int(limb.hold) for limb in knot.limbs)
            names = [self.plan.holds[hold].name for hold in held if hold >= 0]
            if len(names) < len(LIMB_NAMES) or useless.keys() & set(names) or held in seen:
                continue
            seen.add(held)
            rpy_deg = np.degrees(knot.body_rpy_rad).tolist()
            body = {"position_m": list(knot.body_position_w_m), "rpy_deg": rpy_deg, "tolerance_m": 0.02}
            grasps = {name: self._grasp(limb) for name, limb in zip(LIMB_NAMES, knot.limbs, strict=True)}
            goals.append({"body": body, "grasps": {n: {k: g[k] for k in ("hold", "faces")} for n, g in grasps.items()}})
        return goals

    def _start(self) -> dict[str, Any]:
        start: dict[str, Any] = {"body": self._body(), "grasps": {}, "air": {}}
        for limb, name in enumerate(LIMB_NAMES):
            if self.grips(limb):
                start["grasps"][name] = self._grasp(self.grasp(limb))
            else:
                start["air"][name] = _in_air(self.status.reference[limb], self.status.telemetry[limb])
        return start

    def _body(self) -> dict[str, Any]:
        """Where the body is, within the bounds (7) of any plan: height, tilt, and how far a gripper turns under it."""
        state, bounds = self.status.state, self.robot.body
        low, high = bounds.height_m
        height = min(max(state.body_position_w_m[2], low + INSIDE_M), high - INSIDE_M)
        roll, pitch, yaw = _rpy(state.body_quaternion_w)
        tilt = bounds.max_tilt_rad - INSIDE_RAD
        yaws = [self.status.reference[limb].gripper_yaw_w_rad for limb in range(len(LIMB_NAMES)) if self.grips(limb)]
        back, forth = self.robot.grasp.gripper_yaw_rad
        turned = np.clip(yaw, max(yaws) - forth + INSIDE_RAD, min(yaws) - back - INSIDE_RAD) if yaws else yaw
        rpy_rad = [*np.clip([roll, pitch], -tilt, tilt), turned]
        return {"position_m": [*state.body_position_w_m[:2], height], "rpy_deg": np.degrees(rpy_rad).tolist()}

    def _measure(self, content: Document) -> None:
        """Holds to where they are gripped, as wide as they are there, with the friction they slipped at; what is no
        hold becomes an obstacle."""
        useless = self.useless()
        for limb in filter(self.grips, range(len(LIMB_NAMES))):
            hold = next(each for each in content["holds"] if each["name"] == self.hold(limb))
            telemetry, grasp = self.status.telemetry[limb], self.grasp(limb)
            turned_rad = self._turned(limb)
            turned_rad = turned_rad if abs(turned_rad) > TURN_RAD else 0.0
            shift_m = shift_of(self.plan.holds[grasp.hold], grasp, telemetry, turned_rad)
            shift_m = shift_m if math.hypot(*shift_m) > SHIFT_M else (0.0, 0.0)
            foot = moved(foot_of(hold), shift_m, turned_rad)
            set_foot(hold, replace(foot, size_m=self._as_wide(foot.size_m, limb)))
            if telemetry.slip_friction > 0.0:
                change_friction(hold, partial(min, telemetry.slip_friction))
        for lost in [each for each in content["holds"] if each["name"] in useless]:
            content["holds"].remove(lost)
            if (obstacle := self._left_of(lost, useless[lost["name"]])) is not None:
                content["obstacles"] = [*content.get("obstacles", []), obstacle]

    def _as_wide(self, size_m: tuple[float, float, float], limb: int) -> tuple[float, float, float]:
        """A hold's size, as much wider between the fingers as these are further apart than they were planned."""
        opening_m, grasp = self.status.reference[limb].finger_opening_m, self.grasp(limb)
        wider_m = 2 * opening_m - grasp.finger_separation_m
        if opening_m <= 0.0 or abs(wider_m) <= SHIFT_M:
            return size_m
        x, y, z = size_m
        across = FACE_NAMES[grasp.finger1_face][1:]  # the axis between the fingers
        return (x + wider_m, y, z) if across == "x" else (x, y + wider_m, z)

    def _turned(self, limb: int) -> float:
        """By which a limb's gripper is turned from its reference [rad]."""
        reference = self.status.reference[limb]
        return yaw_of(self.status.telemetry[limb], reference.gripper_yaw_w_rad) - float(reference.gripper_yaw_w_rad)

    def _left_of(self, hold: Document, limb: int) -> Document | None:
        """What stands where a hold was: nothing where fingers closed further than it is wide, else an obstacle; where
        fingers are about it they show its place."""
        telemetry, grasp = self.status.telemetry[limb], self.grasp(limb)
        off_m = np.subtract(telemetry.gripper_position_w_m, grasp.gripper_position_w_m)[:2]
        left, foot = as_obstacle(hold), foot_of(hold)
        if np.linalg.norm(off_m) < min(foot.size_m[:2]) / 2:
            if self._phase(limb) in GRIPPING:
                return None
            turned_rad = self._turned(limb)
            shift_m = shift_of(self.plan.holds[grasp.hold], grasp, telemetry, turned_rad)
            set_foot(left, moved(foot, shift_m, turned_rad))
        return left


def _in_air(reference: limb_reference_t, telemetry: limb_telemetry_t) -> dict[str, Any]:
    yaw = yaw_of(telemetry, reference.gripper_yaw_w_rad)
    place = [float(v) for v in telemetry.gripper_position_w_m]
    return {"position_m": place, "yaw_deg": math.degrees(yaw), "opening_m": reference.finger_opening_m}


def shift_of(hold: hold_t, grip: limb_knot_t, telemetry: limb_telemetry_t, turned_rad: float) -> tuple[float, float]:
    """By which the middle of a hold's foot is off the plan's along x and y of W [m], where its gripper, that is off
    the planned grip, goes with the hold, and this is turned about W's z."""
    c, s = math.cos(turned_rad), math.sin(turned_rad)
    x, y = np.subtract(grip.gripper_position_w_m, hold.position_w_m)[:2]
    at_x, at_y = telemetry.gripper_position_w_m[:2]
    foot_x, foot_y = hold.position_w_m[:2]
    return float(at_x - (c * x - s * y) - foot_x), float(at_y - (s * x + c * y) - foot_y)


def yaw_of(telemetry: limb_telemetry_t, near: float) -> float:
    """Of the gripper, its tilt left out, the one nearest to another [rad]."""
    return near + math.remainder(_yaw_and_tilt(telemetry)[0] - near, 2 * math.pi)


def _yaw_and_tilt(telemetry: limb_telemetry_t) -> tuple[float, Any]:
    (rotation,) = rotations_from_quaternions(np.array([telemetry.gripper_quaternion_w], dtype=float))
    return yaw_and_tilt(rotation)


def _rpy(quaternion: Any) -> tuple[float, float, float]:
    """Roll, pitch, yaw (intrinsic z-y-x) of a quaternion w, x, y, z."""
    w, x, y, z = quaternion
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
    return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
