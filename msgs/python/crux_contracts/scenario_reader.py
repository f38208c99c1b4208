"""From YAML nodes to a Scenario, noting every problem on the way."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar, cast

from . import LIMB_NAMES
from .reading import Checker, did_you_mean
from .robot import robot_names
from .scenario_checks import check_cuboids, check_grasps
from .scenario_types import (
    FACE_NAMES,
    IDLE,
    LIMIT_SURFACES,
    MARGINS,
    METHODS,
    WEIGHTS,
    BodyPose,
    Contact,
    Faces,
    Goal,
    Grasp,
    Gripper,
    Hold,
    Horizon,
    Obstacle,
    PlannerOptions,
    Scenario,
    ScenarioError,
    Start,
    Uncertainty,
    Wall,
)
from .yaml_document import MAX_BYTES, DocumentError, Node, Problem, parse_mapping

VERSION = 1
MAX_SLOPE_DEG = 110.0
MAX_POSITION_M = 20.0
MAX_BODY_HEIGHT_M = 1.0
MAX_OPENING_M = 0.5
SIZE_M = (0.005, 2.0)
MAX_FRICTION = 5.0
MAX_CUBOIDS = 300
MAX_STEPS = 1000
POSITION = (-MAX_POSITION_M, MAX_POSITION_M, "m")

T = TypeVar("T")


def read_scenario(data: bytes, path: str, any_robot: bool = False) -> Scenario:
    """Raises ScenarioError with all problems found."""
    try:
        if len(data) > MAX_BYTES:
            raise DocumentError(path, [Problem("", f"{len(data)} bytes", f"expected at most {MAX_BYTES} bytes")])
        root = parse_mapping(data, path)
    except DocumentError as error:
        raise ScenarioError(path, error.problems) from None
    return _Reader(path, any_robot).scenario(root, data.decode("utf-8"))


class _Reader:
    def __init__(self, path: str, any_robot: bool) -> None:
        self.check, self.any_robot = Checker(path), any_robot

    def scenario(self, root: Node, text: str) -> Scenario:
        check = self.check
        version = cast(dict[str, Node], root.content).get("version")
        if version is not None and version.content != VERSION:
            raise ScenarioError(
                check.path,
                [Problem("version", version.shown(), f"this crux reads scenario version {VERSION}", version.line)],
            )
        keys = check.members(
            root,
            ["version", "name", "robot", "wall", "contact", "start", "goal", "horizon"],
            ["holds", "obstacles", "uncertainty", "planner"],
        )
        contact = self._of(keys, "contact", self._contact)
        result = {
            "name": self._of(keys, "name", check.text),
            "robot": self._of(keys, "robot", self._robot),
            "wall": self._of(keys, "wall", self._wall),
            "contact": contact,
            "holds": tuple(self._of(keys, "holds", self._holds) or ()),
            "obstacles": tuple(self._of(keys, "obstacles", self._obstacles) or ()),
            "start": self._of(keys, "start", lambda node: self._start(node, contact)),
            "goal": self._of(keys, "goal", lambda node: self._goal(node, contact)),
            "horizon": self._of(keys, "horizon", self._horizon),
            "planner": self._of(keys, "planner", self._planner) or PlannerOptions(),
            "uncertainty": self._of(keys, "uncertainty", lambda node: self._uncertainty(node, contact)),
        }
        for relations in (check_cuboids, check_grasps):  # a wrong value would bring forth more mistakes than were made
            if not check.problems:
                relations(check, keys)
        check.finish(ScenarioError)
        return Scenario(**result, yaml_text=text, path=check.path)  # type: ignore[arg-type]

    @staticmethod
    def _of(keys: dict[str, Node], name: str, read: Callable[[Node], T]) -> T | None:
        return read(keys[name]) if name in keys else None

    def _number(
        self,
        keys: dict[str, Node],
        name: str,
        default: float,
        low: float,
        high: float,
        unit: str = "",
        above: bool = False,
    ) -> float:
        return self.check.number(keys[name], low, high, unit, above) if name in keys else default

    def _robot(self, node: Node) -> str:
        name = self.check.text(node)
        known = robot_names()
        if name and name not in known and not self.any_robot:
            self.check.note(node, f"no such folder under msgs/robots; {did_you_mean(name, known)}")
        return name

    def _wall(self, node: Node) -> Wall:
        keys = self.check.members(node, ["slope_deg"], ["friction"])
        return Wall(
            slope_deg=self._number(keys, "slope_deg", 0.0, 0.0, MAX_SLOPE_DEG, "degrees"),
            friction=self._number(keys, "friction", Wall.friction, 0.0, MAX_FRICTION),
        )

    def _contact(self, node: Node) -> Contact:
        keys = self.check.members(
            node, ["model"], ["patch_radius_m", "max_normal_N", "spine_shear_N", "spine_twist_Nm", "spines_only"]
        )
        model = self._of(keys, "model", lambda n: self.check.choice(n, ("patch", "point")))
        shear = self._number(keys, "spine_shear_N", Contact.spine_shear_N, 0.0, 200.0, "N")
        spines_only = self._of(keys, "spines_only", self._spines_only) or {}
        if spines_only and model == "point":
            self.check.note(keys["spines_only"], "does not go with contact.model point: feet have no fingers")
        elif spines_only and shear == 0.0:
            self.check.note(keys["spines_only"], "there are no spines to hang on by: give contact.spine_shear_N")
        return Contact(
            model="point" if model == "point" else "patch",
            patch_radius_m=self._number(keys, "patch_radius_m", Contact.patch_radius_m, 0.001, 0.1, "m"),
            max_normal_N=self._number(keys, "max_normal_N", Contact.max_normal_N, 0.0, 1000.0, "N", above=True),
            spine_shear_N=shear,
            spine_twist_Nm=self._number(keys, "spine_twist_Nm", Contact.spine_twist_Nm, 0.0, 10.0, "Nm"),
            spines_only=spines_only,
        )

    def _spines_only(self, node: Node) -> dict[str, int]:
        """By limb, the finger that never presses."""
        keys = self.check.members(node, [], LIMB_NAMES)
        return {limb: self.check.integer(keys[limb], 1, 2) for limb in LIMB_NAMES if limb in keys}

    def _holds(self, node: Node) -> list[Hold]:
        return [self._hold(item) for item in self.check.items(node, MAX_CUBOIDS)]

    def _obstacles(self, node: Node) -> list[Obstacle]:
        return [self._obstacle(item) for item in self.check.items(node, MAX_CUBOIDS)]

    def _hold(self, node: Node) -> Hold:
        keys = self.check.members(node, ["name", "position_m", "size_m", "friction"], ["yaw_deg", "spines"])
        name, position, size, yaw = self._cuboid(keys)
        friction = self._of(keys, "friction", self._friction) or (0.0,) * len(FACE_NAMES)
        spines = self._of(keys, "spines", self._spines) or (True,) * len(FACE_NAMES)
        return Hold(name, position, size, yaw, friction, spines)

    def _obstacle(self, node: Node) -> Obstacle:
        return Obstacle(*self._cuboid(self.check.members(node, ["name", "position_m", "size_m"], ["yaw_deg"])))

    def _cuboid(self, keys: dict[str, Node]) -> tuple[str, tuple[float, float], tuple[float, float, float], float]:
        check = self.check
        name = self._of(keys, "name", check.text) or ""
        position = self._of(keys, "position_m", lambda n: check.numbers(n, 2, *POSITION)) or (0.0, 0.0)
        size = self._of(keys, "size_m", lambda n: check.numbers(n, 3, *SIZE_M, "m")) or (SIZE_M[0],) * 3
        yaw = self._number(keys, "yaw_deg", 0.0, -360.0, 360.0, "degrees")
        return name, (position[0], position[1]), (size[0], size[1], size[2]), yaw

    def _friction(self, node: Node) -> tuple[float, ...]:
        if isinstance(node.content, dict):
            keys = self.check.members(node, FACE_NAMES)
            return tuple(self._number(keys, face, 0.0, 0.0, MAX_FRICTION) for face in FACE_NAMES)
        return (self.check.number(node, 0.0, MAX_FRICTION),) * len(FACE_NAMES)

    def _spines(self, node: Node) -> tuple[bool, ...]:
        if isinstance(node.content, dict):
            keys = self.check.members(node, [], FACE_NAMES)
            return tuple(self.check.flag(keys[face]) if face in keys else True for face in FACE_NAMES)
        return (self.check.flag(node),) * len(FACE_NAMES)

    def _body(self, node: Node, tolerances: tuple[str, ...] = ()) -> tuple[BodyPose, dict[str, Node]]:
        check = self.check
        keys = check.members(node, ["position_m"], ["rpy_deg", *tolerances])
        position = [0.0, 0.0, 0.0]
        if "position_m" in keys:
            place = keys["position_m"]
            if isinstance(place.content, list) and len(place.content) == len(position):
                x, y, z = place.content
                position = [check.number(x, *POSITION), check.number(y, *POSITION)]
                position.append(check.number(z, 0.0, MAX_BODY_HEIGHT_M, "m", above=True))
            else:
                check.note(place, "expected a list of 3 numbers in m")
        rpy = check.numbers(keys["rpy_deg"], 3, -180.0, 180.0, "degrees") if "rpy_deg" in keys else (0.0, 0.0, 0.0)
        return BodyPose((position[0], position[1], position[2]), (rpy[0], rpy[1], rpy[2])), keys

    def _grasp(self, node: Node) -> Grasp:
        keys = self.check.members(node, ["hold", "faces"], ["finger1"])
        hold = self._of(keys, "hold", self.check.text) or ""
        faces = self._of(keys, "faces", lambda n: self.check.choice(n, ("x", "y"))) or "x"
        sides = (f"+{faces}", f"-{faces}")
        finger1 = self.check.choice(keys["finger1"], sides) if "finger1" in keys else None
        return Grasp(hold, cast(Faces, faces), finger1)

    def _grasps(self, node: Node, required: tuple[str, ...]) -> dict[str, Grasp]:
        keys = self.check.members(node, required, [limb for limb in LIMB_NAMES if limb not in required])
        return {limb: self._grasp(keys[limb]) for limb in LIMB_NAMES if limb in keys}

    def _air(self, node: Node) -> dict[str, Gripper]:
        keys = self.check.members(node, [], LIMB_NAMES)
        return {limb: self._gripper(keys[limb]) for limb in LIMB_NAMES if limb in keys}

    def _gripper(self, node: Node) -> Gripper:
        keys = self.check.members(node, ["position_m", "opening_m"], ["yaw_deg"])
        place = self._of(keys, "position_m", lambda n: self.check.numbers(n, 3, *POSITION)) or (0.0, 0.0, 0.0)
        return Gripper(
            (place[0], place[1], place[2]),
            yaw_deg=self._number(keys, "yaw_deg", 0.0, -360.0, 360.0, "degrees"),
            opening_m=self._number(keys, "opening_m", 0.0, 0.0, MAX_OPENING_M, "m"),
        )

    def _start(self, node: Node, contact: Contact | None) -> Start:
        check = self.check
        needed, other = ("feet", "grasps") if contact and contact.model == "point" else ("grasps", "feet")
        if contact and isinstance(node.content, dict) and other in node.content:
            check.note_at(node.content[other], "", "", f"does not go with contact.model {contact.model}; use {needed}")
        keys = check.members(node, ["body", needed], [other, "air"] if needed == "grasps" else [other])
        body = self._of(keys, "body", lambda n: self._body(n)[0]) or BodyPose((0.0, 0.0, 0.0))
        if needed == "grasps":
            air = self._of(keys, "air", self._air) or {}
            others = tuple(limb for limb in LIMB_NAMES if limb not in air)
            grasps = self._of(keys, "grasps", lambda n: self._grasps(n, others)) or {}
            for limb in grasps.keys() & air.keys():
                check.note(keys["air"], f"{limb} has a grasp in start.grasps: it is there or in the air")
            return Start(body, grasps=grasps, air=air)
        return Start(body, feet=self._of(keys, "feet", self._feet) or {})

    def _feet(self, node: Node) -> dict[str, tuple[float, float]]:
        keys = self.check.members(node, LIMB_NAMES)
        feet = {limb: self.check.numbers(keys[limb], 2, *POSITION) for limb in LIMB_NAMES if limb in keys}
        return {limb: (foot[0], foot[1]) for limb, foot in feet.items()}

    def _goal(self, node: Node, contact: Contact | None) -> Goal:
        keys = self.check.members(node, ["body"], ["grasps"])
        body = BodyPose((0.0, 0.0, 0.0))
        body_keys: dict[str, Node] = {}
        if "body" in keys:
            body, body_keys = self._body(keys["body"], ("tolerance_m", "tolerance_deg"))
        grasps = self._of(keys, "grasps", lambda n: self._grasps(n, ())) or {}
        if grasps and contact and contact.model == "point":
            self.check.note(keys["grasps"], "does not go with contact.model point")
        return Goal(
            body,
            tolerance_m=self._number(body_keys, "tolerance_m", Goal.tolerance_m, 0.0005, 0.2, "m"),
            tolerance_deg=self._number(body_keys, "tolerance_deg", Goal.tolerance_deg, 0.1, 45.0, "degrees"),
            grasps=grasps,
        )

    def _horizon(self, node: Node) -> Horizon:
        keys = self.check.members(node, ["steps", "dt_s"])
        steps = self._of(keys, "steps", lambda n: self.check.integer(n, 1, MAX_STEPS)) or 1
        return Horizon(steps, self._number(keys, "dt_s", 1.0, 0.01, 20.0, "s"))

    def _uncertainty(self, node: Node, contact: Contact | None) -> Uncertainty:
        check = self.check
        if contact and contact.model == "point":
            check.note_at(node, "", "", "does not go with contact.model point: only climbs are planned so")
        named = ["friction", "hold_position_m", "hold_yaw_deg", "mass_kg", "centre_of_mass_m"]
        keys = check.members(node, [], [*named, "sigmas"])
        sigmas = self._number(keys, "sigmas", 1.0, 0.0, 10.0, above=True)
        most = (0.95, 0.05, 30.0, 20.0, 0.1)
        units = ("", "m", "degrees", "kg", "m")
        read = [
            sigmas * self._number(keys, name, 0.0, 0.0, high / sigmas, unit)
            for name, high, unit in zip(named, most, units, strict=True)
        ]
        return Uncertainty(read[0], read[1], math.radians(read[2]), *read[3:])

    def _planner(self, node: Node) -> PlannerOptions:
        check = self.check
        simple = ["method", "rho", "iterations", "time_limit_s", "limit_surface", "idle"]
        keys = check.members(node, [], [*simple, "weights", "margins"])
        return PlannerOptions(
            method=self._of(keys, "method", lambda n: check.choice(n, METHODS)) or "auto",
            rho=self._of(keys, "rho", lambda n: check.number(n, 0.0, 1e6, above=True)),
            iterations=self._of(keys, "iterations", lambda n: check.integer(n, 1, 1000)),
            time_limit_s=self._of(keys, "time_limit_s", lambda n: check.number(n, 0.1, 86400.0, "s")),
            limit_surface=self._of(keys, "limit_surface", lambda n: check.choice(n, LIMIT_SURFACES)) or "cone",
            idle=self._of(keys, "idle", lambda n: check.choice(n, IDLE)) or "cut",
            weights=self._of(keys, "weights", lambda n: self._named_numbers(n, WEIGHTS, 1e9)) or {},
            margins=self._of(keys, "margins", lambda n: self._named_numbers(n, MARGINS, 1.0)) or {},
        )

    def _named_numbers(self, node: Node, names: tuple[str, ...], high: float) -> dict[str, float]:
        keys = self.check.members(node, [], names)
        return {name: self.check.number(member, 0.0, high) for name, member in keys.items()}
