"""Which holds of a map a robot grips: from its joints, as a runtime or a log reports them, and from nothing else."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import FACE_NAMES, Scenario, parse_scenario
from crux_contracts.scenario_document import foot_of, moved, scenario_document, set_foot
from crux_msgs import robot_state_t
from crux_planner import Faces
from numpy.typing import NDArray

from crux_tools.errors import UsageError
from crux_tools.guide.situation import INSIDE_M, INSIDE_RAD, LEAST_STEPS, SHIFT_M
from crux_tools.operator_status import GRIPPING
from crux_tools.telemetry.rotations import angle_between, rotations_from_quaternions

Floats = NDArray[np.float64]
LEAST_GRIPS = 3  # by which a stance is recognised: two leave a turn open
OFF_M, OFF_RAD = 0.025, 0.12  # of a gripper to its hold, as the others stand
WIDTH_M = 0.008  # of a hold, as its fingers measure it
SAME_M = 0.01  # fits that differ by less say nothing of which is right


@dataclass(frozen=True)
class Felt:
    """One gripper: frame of the body; `opening_m`: pad face to gripper centre."""

    grips: bool
    position_B_m: Floats
    rotation_BG: Floats
    opening_m: float


@dataclass(frozen=True)
class Place:
    """One way to grip one hold; frame W."""

    hold: int
    finger1: str
    centre_W_m: Floats
    yaw_rad: float
    half_m: float
    grip: int | None = None
    """number of the hold's grips on these faces, where it has any"""


@dataclass(frozen=True)
class Stance:
    """Where the body is, and what the limbs that grip are on."""

    position_W_m: Floats
    rotation_WB: Floats
    places: Mapping[int, Place]
    off_m: float

    def says(self, scenario: Scenario) -> str:
        """In a line."""
        return ", ".join(
            f"{LIMB_NAMES[limb]} on {scenario.holds[place.hold].name}" for limb, place in self.places.items()
        )


def felt_of(status: Any) -> list[Felt]:
    """Of a status_t, or of anything with its state, reference and telemetry."""
    (body,) = rotations_from_quaternions(np.array([status.state.body_quaternion_w]))
    origin = np.array(status.state.body_position_w_m)
    felt = []
    for reference, telemetry in zip(status.reference, status.telemetry, strict=True):
        (gripper,) = rotations_from_quaternions(np.array([telemetry.gripper_quaternion_w]))
        position = body.T @ (np.array(telemetry.gripper_position_w_m) - origin)
        felt.append(
            Felt(int(reference.phase) in GRIPPING, position, body.T @ gripper, float(reference.finger_opening_m))
        )
    return felt


def places_of(scenario: Scenario, robot: Robot) -> list[Place]:
    """All that the gripper can span, pads as high as a plan has them."""
    places = []
    for number, hold in enumerate(scenario.holds):
        for pair in (0, 1):
            names = FACE_NAMES[2 * pair : 2 * pair + 2]
            for which, grip in enumerate(hold.places(names[0][1:])):
                faces = Faces.of(hold, pair, robot, scenario.contact.patch_radius_m, grip)
                if faces is None:
                    continue
                yaw = hold.yaw_rad + pair * math.pi / 2
                middle = np.array([*hold.position_m, hold.foot_z_m])
                centre = middle + _turn(yaw) @ [faces.off_m, faces.aside_m, faces.height_m]
                for way, name in enumerate(names):
                    turned, at = yaw + way * math.pi, None if grip is None else which
                    places.append(Place(number, name, centre, turned, faces.half_m, at))
    return places


def recognise(
    scenario: Scenario, robot: Robot, felt: Sequence[Felt], on: Mapping[str, str], near: tuple[Floats, Floats] | None
) -> Stance:
    """The stance on the scenario's map that fits what is felt, with the head less than a quarter turn from the goal's.

    `on`: holds that an operator names, by limb; `near`: the body's position and rotation where the runtime knows them.
    Raises UsageError where none fits, or several do.
    """
    gripping = [limb for limb in range(len(LIMB_NAMES)) if felt[limb].grips]
    if len(gripping) < LEAST_GRIPS:
        names = ", ".join(LIMB_NAMES[limb] for limb in gripping) or "none"
        raise UsageError(f"{LEAST_GRIPS} grippers at least must be on holds; those whose fingers press: {names}")
    can = {
        limb: _fitting(scenario, places_of(scenario, robot), felt[limb], on.get(LIMB_NAMES[limb])) for limb in gripping
    }
    for limb, places in can.items():
        if not places:
            width_mm = 2e3 * felt[limb].opening_m
            raise UsageError(f"{LIMB_NAMES[limb]}: no hold of the map is {width_mm:.0f} mm wide, as its fingers stand")
    fits = list[Stance]()
    for first in can[gripping[0]]:
        fits += _with_first(first, gripping, can, felt)
    if near is not None:
        fits = [fit for fit in fits if _is_near(fit, near)]
    goal_yaw_rad = scenario.goal.body.rpy_rad[2]
    fits = [fit for fit in fits if abs(math.remainder(_yaw(fit.rotation_WB) - goal_yaw_rad, math.tau)) < math.pi / 2]
    fits = sorted(
        {tuple(p.hold for p in fit.places.values()): fit for fit in sorted(fits, key=_off, reverse=True)}.values(),
        key=_off,
    )
    if not fits:
        raise UsageError(f"the grippers of {', '.join(LIMB_NAMES[limb] for limb in gripping)} fit no holds of the map")
    rivals = [fit for fit in fits[1:] if fit.off_m < fits[0].off_m + SAME_M]
    if rivals and near is None:
        said = "; or ".join(fit.says(scenario) for fit in [fits[0], *rivals][:3])
        raise UsageError(f"{1 + len(rivals)} stances of the map look alike: {said}; say one hold by --on LIMB=HOLD")
    return fits[0]


def _yaw(rotation: Floats) -> float:
    return math.atan2(rotation[1, 0], rotation[0, 0])


def _off(stance: Stance) -> float:
    return stance.off_m


def _fitting(scenario: Scenario, places: Sequence[Place], felt: Felt, hold: str | None) -> list[Place]:
    names = [each.name for each in scenario.holds]
    if hold is not None and hold not in names:
        raise UsageError(f"--on: the map has no hold '{hold}'; it has {', '.join(names)}")
    return [
        place
        for place in places
        if abs(place.half_m - felt.opening_m) < WIDTH_M and (hold is None or names[place.hold] == hold)
    ]


def _turn(yaw_rad: float) -> Floats:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _with_first(
    first: Place, gripping: Sequence[int], can: Mapping[int, Sequence[Place]], felt: Sequence[Felt]
) -> list[Stance]:
    """Stances in which the first limb is there: it says how the body is turned, and so where the others are."""
    one = felt[gripping[0]]
    rotation = _turn(first.yaw_rad) @ one.rotation_BG.T
    body = first.centre_W_m - rotation @ one.position_B_m
    choices = [[first]]
    for limb in gripping[1:]:
        at = body + rotation @ felt[limb].position_B_m
        choices.append(
            [
                place
                for place in can[limb]
                if np.linalg.norm(at - place.centre_W_m) < 3 * OFF_M
                and angle_between(_turn(place.yaw_rad), rotation @ felt[limb].rotation_BG) < 2 * OFF_RAD
            ]
        )
    stances = [_fitted(dict(zip(gripping, chosen, strict=True)), felt) for chosen in itertools.product(*choices)]
    return [stance for stance in stances if stance is not None]


def _fitted(places: Mapping[int, Place], felt: Sequence[Felt]) -> Stance | None:
    """The rigid motion that lays the grippers on their places best [Kabsch 1976]."""
    if len({place.hold for place in places.values()}) < len(places):
        return None
    seen = np.array([felt[limb].position_B_m for limb in places])
    there = np.array([place.centre_W_m for place in places.values()])
    u, _, vt = np.linalg.svd((seen - seen.mean(axis=0)).T @ (there - there.mean(axis=0)))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    rotation = vt.T @ flip @ u.T
    body = there.mean(axis=0) - rotation @ seen.mean(axis=0)
    off_m = float(np.linalg.norm(body + seen @ rotation.T - there, axis=1).max())
    turned = [angle_between(_turn(place.yaw_rad), rotation @ felt[limb].rotation_BG) for limb, place in places.items()]
    return Stance(body, rotation, places, off_m) if off_m < OFF_M and max(turned) < OFF_RAD else None


def _is_near(stance: Stance, near: tuple[Floats, Floats]) -> bool:
    position, rotation = near
    return (
        float(np.linalg.norm(stance.position_W_m - position)) < 3 * OFF_M
        and angle_between(stance.rotation_WB, rotation) < 2 * OFF_RAD
    )


def scenario_from(scenario: Scenario, robot: Robot, status: Any, on: Mapping[str, str]) -> tuple[Scenario, Stance]:
    """`scenario` from where the robot hangs: its start, and the holds that are gripped where they were found. `status`
    as of felt_of(). Raises UsageError, ScenarioError."""
    if scenario.tilts:
        raise UsageError(
            "holds or grips that are turned out of the wall's plane: a robot on such walls is not recognised yet"
        )
    state = status.state
    near = None
    if state.supervisor_state != robot_state_t.IDLE:
        (rotation,) = rotations_from_quaternions(np.array([state.body_quaternion_w]))
        near = np.array(state.body_position_w_m), rotation
    felt = felt_of(status)
    stance = recognise(scenario, robot, felt, on, near)
    content = scenario_document(scenario.yaml_text, scenario.path)
    start: dict[str, Any] = {"body": _body(stance, robot), "grasps": {}, "air": {}}
    for limb, name in enumerate(LIMB_NAMES):
        at = stance.position_W_m + stance.rotation_WB @ felt[limb].position_B_m
        if limb in stance.places:
            place = stance.places[limb]
            hold = content["holds"][place.hold]
            grasp = {"hold": hold["name"], "faces": place.finger1[1:], "finger1": place.finger1}
            start["grasps"][name] = grasp | ({} if place.grip is None else {"grip": place.grip})
            if np.linalg.norm(off_m := (at - place.centre_W_m)[:2]) > SHIFT_M:
                set_foot(hold, moved(foot_of(hold), off_m.tolist(), 0.0))
        else:
            axis = stance.rotation_WB @ felt[limb].rotation_BG[:, 0]
            yaw_deg = math.degrees(math.atan2(axis[1], axis[0]))
            position_m = [float(v) for v in at]
            start["air"][name] = {"position_m": position_m, "yaw_deg": yaw_deg, "opening_m": felt[limb].opening_m}
    content["start"] = start
    content["horizon"]["steps"] = max(content["horizon"]["steps"], LEAST_STEPS)
    return parse_scenario(content, "the robot's place"), stance


def _body(stance: Stance, robot: Robot) -> dict[str, Any]:
    """Within the bounds (7) of any plan."""
    bounds = robot.body
    low, high = bounds.height_m
    x, y, z = (float(v) for v in stance.position_W_m)
    tilt = bounds.max_tilt_rad - INSIDE_RAD
    rotation = stance.rotation_WB
    roll, pitch = math.atan2(rotation[2, 1], rotation[2, 2]), math.asin(max(-1.0, min(1.0, -rotation[2, 0])))
    yaw = _yaw(rotation)
    rpy_deg = np.degrees([*np.clip([roll, pitch], -tilt, tilt), yaw]).tolist()
    return {"position_m": [x, y, min(max(z, low + INSIDE_M), high - INSIDE_M)], "rpy_deg": rpy_deg}
