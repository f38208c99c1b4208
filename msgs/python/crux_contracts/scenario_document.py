"""A scenario's document, what its YAML says, for tools that change some of it and parse it again; and where its bodies
are, the same for files of both versions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

from .scenario_types import ScenarioError
from .yaml_document import DocumentError, parse_mapping, values

Document = dict[str, Any]


def scenario_document(text: str, path: str = "scenario") -> Document:
    """Of a scenario's YAML text, a new one at every call. Raises ScenarioError, which names `path`, for what is no
    mapping in YAML; only parse_scenario() checks what is in it.
    """
    try:
        return cast(Document, values(parse_mapping(text.encode("utf-8", errors="surrogatepass"), path)))
    except DocumentError as error:
        raise ScenarioError(error.path, error.problems) from None


@dataclass(frozen=True)
class Foot:
    """Of a hold or an obstacle of a document that parse_scenario() takes."""

    position_m: tuple[float, float]
    """x, y of its middle in W"""
    size_m: tuple[float, float, float]
    """edges of the foot along the body's own axes, and the body's height"""
    yaw_deg: float
    """about W's z, the last of the body's turns"""


def foot_of(body: Document) -> Foot:
    """Where a body is."""
    if "pose" in body:
        pose = body["pose"]
        (x, y, _), size, yaw_deg = pose["position_m"], body["shape"]["box_m"], pose.get("rpy_deg", (0.0, 0.0, 0.0))[2]
    else:
        (x, y), size, yaw_deg = body["position_m"], body["size_m"], body.get("yaw_deg", 0.0)
    return Foot((x, y), (size[0], size[1], size[2]), yaw_deg)


def set_foot(body: Document, foot: Foot) -> None:
    """Lays a body there. What it is beside (roll and pitch, height of the foot, faces that lean) stays, and so does
    what the document says already.
    """
    old = foot_of(body)
    position, size = list(foot.position_m), list(foot.size_m)
    if "pose" in body:
        pose = body["pose"]
        if old.position_m != foot.position_m:
            pose["position_m"] = [*position, pose["position_m"][2]]
        if old.yaw_deg != foot.yaw_deg:
            pose["rpy_deg"] = [*pose.get("rpy_deg", (0.0, 0.0))[:2], foot.yaw_deg]
        if old.size_m != foot.size_m:
            body["shape"]["box_m"] = size
        return
    if old.position_m != foot.position_m:
        body["position_m"] = position
    if old.yaw_deg != foot.yaw_deg:
        body["yaw_deg"] = foot.yaw_deg
    if old.size_m != foot.size_m:
        body["size_m"] = size


def moved(foot: Foot, shift_m: Sequence[float], turned_rad: float) -> Foot:
    """The foot shifted along x, y of W, and turned about its own middle."""
    x, y = foot.position_m
    position_m = (float(x + shift_m[0]), float(y + shift_m[1]))
    return Foot(position_m, foot.size_m, foot.yaw_deg + math.degrees(turned_rad))


def change_friction(hold: Document, change: Callable[[float], float]) -> None:
    """That of all faces of a hold, and of its grips."""
    for body in (hold, *hold.get("grips", [])):
        given = body.get("friction")
        if isinstance(given, dict):
            body["friction"] = {face: change(each) for face, each in given.items()}
        elif given is not None:
            body["friction"] = list(map(change, given)) if isinstance(given, list) else change(given)


def as_obstacle(hold: Document) -> Document:
    """The box around a hold."""
    kept = ("name", "position_m", "size_m", "yaw_deg", "pose")
    shape = {"shape": {"box_m": hold["shape"]["box_m"]}} if "shape" in hold else {}
    return {key: hold[key] for key in kept if key in hold} | shape
