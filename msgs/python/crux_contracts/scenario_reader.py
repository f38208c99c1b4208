"""From YAML nodes to a Scenario, noting every problem on the way."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

from . import LIMB_NAMES
from .reading import did_you_mean
from .records import Records, keys_of
from .robot import robot_names
from .scenario_bodies import as_first, keys_of_version
from .scenario_checks import check_cuboids, check_grasps, check_places
from .scenario_types import (
    FACE_NAMES,
    MAX_BODY_HEIGHT_M,
    MAX_FRICTION,
    POSITION,
    VERSIONS,
    Contact,
    Goal,
    Grasp,
    PlannerOptions,
    Scenario,
    ScenarioError,
    Standing,
    Start,
    Uncertainty,
)
from .yaml_document import MAX_BYTES, DocumentError, Node, Problem, parse_mapping

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


def _members(node: Node) -> dict[str, Node]:
    return node.content if isinstance(node.content, dict) else {}


class _Reader(Records):
    def __init__(self, path: str, any_robot: bool) -> None:
        super().__init__(path)
        self.any_robot, self.model = any_robot, ""  # of contact, where it is known
        self.version = VERSIONS[0]

    def scenario(self, root: Node, text: str) -> Scenario:
        check, version = self.check, _members(root).get("version")
        known = version is None or (version.content in VERSIONS and not isinstance(version.content, bool))
        if version is not None and not known:
            says = f"this crux reads scenario versions {VERSIONS[0]} and {VERSIONS[1]}"
            raise ScenarioError(check.path, [Problem("version", version.shown(), says, version.line)])
        self.version = VERSIONS[0] if version is None else int(str(version.content))
        keys = keys_of_version(self.version)
        required = ["version", *(name for name, key in keys.items() if key.required)]
        members = check.members(root, required, [name for name in keys if name not in required])
        ordered = sorted((name for name in keys if name in members), key=lambda name: name != "contact")
        read = {name: self.value(keys[name], members[name]) for name in ordered}
        if "wall" not in keys:
            read = as_first(read, members, check)
        for relations in (
            check_places,
            check_cuboids,
            check_grasps,
        ):  # a wrong value would bring forth more mistakes than were made
            if not check.problems:
                relations(check, members)
        check.finish(ScenarioError)
        return Scenario(**read, yaml_text=text, path=check.path)

    def record(self, kind: type[T], *nodes: Node, place: str = "") -> T:
        if kind is Grasp and self.version > VERSIONS[0] and "foothold" in _members(nodes[0]):
            standing: Any = Grasp("", "", foothold=super().record(Standing, *nodes, place=place).foothold)
            return standing  # type: ignore[no-any-return]
        made = super().record(kind, *nodes, place=place)
        if isinstance(made, Grasp) and made.finger1 is not None:
            self.check.choice(_members(nodes[0])["finger1"], (f"+{made.faces or 'x'}", f"-{made.faces or 'x'}"))
        if isinstance(made, PlannerOptions) and made.objective != "paper" and self.model == "point":
            self.check.note(
                _members(nodes[0])["objective"], "does not go with contact.model point: only climbs are timed"
            )
        return made

    def robot(self, node: Node) -> str:
        name, known = self.check.text(node), robot_names()
        if name and name not in known and not self.any_robot:
            self.check.note(node, f"no such folder under msgs/robots or CRUX_ROBOTS; {did_you_mean(name, known)}")
        return name

    def contact(self, node: Node) -> Contact:
        contact, members = self.record(Contact, node), _members(node)
        self.model = contact.model or "patch"
        if contact.spines_only and self.model == "point":
            self.check.note(members["spines_only"], "does not go with contact.model point: feet have no fingers")
        elif contact.spines_only and contact.spine_shear_N == 0.0:
            why = "there are no spines to hang on by: give contact.spine_shear_N"
            self.check.note(members["spines_only"], why)
        return contact

    def friction(self, node: Node) -> tuple[float, ...]:
        if isinstance(node.content, dict):
            faces = self.check.members(node, FACE_NAMES)
            return tuple(self.check.number(faces[face], 0.0, MAX_FRICTION) for face in FACE_NAMES if face in faces)
        return (self.check.number(node, 0.0, MAX_FRICTION),) * len(FACE_NAMES)

    def pads(self, node: Node) -> tuple[float, ...]:
        if isinstance(node.content, list):
            return self.check.numbers(node, 2, 0.0, MAX_FRICTION)
        return (self.check.number(node, 0.0, MAX_FRICTION),) * 2

    def spines(self, node: Node) -> tuple[bool, ...]:
        if isinstance(node.content, dict):
            faces = self.check.members(node, [], FACE_NAMES)
            return tuple(self.check.flag(faces[face]) if face in faces else True for face in FACE_NAMES)
        return (self.check.flag(node),) * len(FACE_NAMES)

    def plain(self, node: Node) -> str:
        return str(node.content)  # `record` looks at it

    def place(self, node: Node) -> tuple[float, ...]:
        if not isinstance(node.content, list) or len(node.content) != 3:
            self.check.note(node, "expected a list of 3 numbers in m")
            return (0.0, 0.0, 0.0)
        x, y, z = node.content
        on_wall = (self.check.number(x, *POSITION), self.check.number(y, *POSITION))
        return (*on_wall, self.check.number(z, 0.0, MAX_BODY_HEIGHT_M, "m", above=True))

    def start(self, node: Node) -> Start:
        keys = keys_of(Start)
        needed, other = ("feet", "grasps") if self.model == "point" else ("grasps", "feet")
        if self.model and other in _members(node):
            why = f"does not go with contact.model {self.model}; use {needed}"
            self.check.note_at(_members(node)[other], "", "", why)
        members = self.check.members(node, ["body", needed], [other, "air"] if needed == "grasps" else [other])
        in_air = self.mapping(keys["air"], members["air"]) if "air" in members else {}
        read: dict[str, Any] = {"body": self.value(keys["body"], members["body"]) if "body" in members else None}
        if needed in members:
            others = LIMB_NAMES if needed == "feet" else [limb for limb in LIMB_NAMES if limb not in in_air]
            read[needed] = self.mapping(keys[needed], members[needed], others)
        for limb in read.get("grasps", {}).keys() & in_air.keys():
            self.check.note(members["air"], f"{limb} has a grasp in start.grasps: it is there or in the air")
        return Start(**read, air=in_air)

    def goal(self, node: Node) -> Goal:
        goal = self.record(Goal, node)
        if goal.grasps and self.model == "point":
            self.check.note(_members(node)["grasps"], "does not go with contact.model point")
        return goal

    def uncertainty(self, node: Node) -> Uncertainty:
        """Numbers may be so large that `sigmas` of them are not too much."""
        if self.model == "point":
            self.check.note_at(node, "", "", "does not go with contact.model point: only climbs are planned so")
        keys = keys_of(Uncertainty)
        members = self.check.members(node, [], list(keys))
        sigmas = self.value(keys["sigmas"], members.pop("sigmas")) if "sigmas" in members else 1.0
        read = {
            name: sigmas * self.value(replace(keys[name], high=keys[name].high / sigmas), members[name])
            for name in keys
            if name in members
        }
        return Uncertainty(**read, sigmas=sigmas)
