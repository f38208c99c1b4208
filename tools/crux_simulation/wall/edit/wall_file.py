"""The one file that the editor reads and writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from crux_contracts.output_file import OutputError, look_at_outputs, write_whole
from crux_contracts.robot import Robot, load_robot, robot_names
from crux_contracts.scenario import Scenario, parse_scenario
from crux_contracts.yaml_document import parse_mapping, read_bytes, values
from crux_tools.errors import UsageError

from crux_simulation.wall.edit.content import (
    Content,
    Sketch,
    content_with,
    empty_wall,
    missing,
    places_of,
    scenario_of,
    sketch_of,
)
from crux_simulation.wall.edit.splice import rewritten, written

ORDER = ("version", "name", "robot", "wall", "contact", "holds", "obstacles", "start", "goal", "horizon")
HEAD = "# Drawn by `crux wall edit`. Frame W: x up the wall, y to the left, z off it.\n"


def read_wall(data: bytes, path: Path) -> tuple[Content, Robot]:
    """What a scenario file says, which may lack start and goal, and its robot. Raises DocumentError."""
    content: Any = values(parse_mapping(data, str(path)))
    if not missing(content) or content.get("robot") not in robot_names():
        parse_scenario(data, str(path))  # names the lines of what is wrong
    return content, load_robot(content["robot"])


class WallFile:
    """A scenario, which may lack start and goal, or a new one. `data`: what is on the disk as far as is known."""

    def __init__(self, path: Path, robot: str, slope_deg: float) -> None:
        """Raises ScenarioError or another DocumentError where what is there is no scenario, UsageError of a walk and of
        limbs that stand at an end, and OutputError where it cannot be written.
        """
        self.path = path
        look_at_outputs({"WALL.yaml": path})
        self.data: bytes | None = read_bytes(path) if path.exists() else None
        if self.data is None:
            self.robot = load_robot(robot)
            self.content = empty_wall(path.stem, self.robot, slope_deg)
        else:
            self.content, self.robot = read_wall(self.data, path)
        self.scenario = scenario_of(self.content, self.robot, str(path))
        if self.scenario.contact.model != "patch":
            raise UsageError(f"{path}: contact.model: point: expected patch: this is about holds for grippers")
        for end in ("start", "goal"):
            for limb, grasp in (self.content.get(end) or {}).get("grasps", {}).items():
                if "foothold" in grasp:
                    what = f"{end}.grasps.{limb}.foothold: {grasp['foothold']}: expected a hold"
                    raise UsageError(f"{path}: {what}: the editor is about limbs that grip")
        self.places = places_of(self.content)

    def sketch(self) -> Sketch:
        """What the page begins with."""
        return sketch_of(self.content, self.scenario, self.places)

    def content_of(self, sketch: Sketch) -> Content:
        """What a sketch says, right or not."""
        return content_with(self.content, self.places, sketch)[0]

    def with_sketch(self, sketch: Sketch) -> tuple[Content, Scenario]:
        """What a sketch says, and the scenario to look at. Raises ScenarioError where it is none."""
        content = self.content_of(sketch)
        return content, scenario_of(content, self.robot, self.path.name)

    def save(self, sketch: Sketch, over: bool) -> str:
        """Writes the file; without `over`, only where nothing is lost by it, else the question to ask. Raises
        OutputError.
        """
        content, kept, places = content_with(self.content, self.places, sketch)
        old = None if self.data is None else self.data.decode()
        text = (
            HEAD + written({key: content[key] for key in ORDER if key in content})
            if old is None
            else rewritten(old, content, kept)
        )
        if not over and (question := self._question(text)):
            return question
        data = (written(content) if text is None else text).encode()
        try:
            write_whole(self.path, data)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written: {error.strerror}") from error
        self.data, self.content, self.places = data, content, places
        return ""

    def _question(self, text: str | None) -> str:
        now = self.path.read_bytes() if self.path.is_file() else None
        if now != self.data and now is not None:
            return f"{self.path.name} has been changed by another program since it was opened. Overwrite its changes?"
        if text is None and b"#" in (self.data or b""):
            return f"The comments in {self.path.name} cannot be kept with this change. Overwrite the file without them?"
        return ""
