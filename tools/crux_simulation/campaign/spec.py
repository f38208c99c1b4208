"""The file that says what a campaign is about, as `crux campaign SPEC.yaml` reads it.

version: 1
walls:
  - {draw: wall, count: 300, slope_deg: 45}
  - {scenario: ../msgs/scenarios/climb-four-holds.yaml}
worlds: [nominal, ../tools/worlds/ordinary.yaml]
seeds: [1, 2, 3]
methods: [auto]

examples/campaign.yaml has every key. File names are relative to the spec's own folder.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from pathlib import Path

from crux_contracts.records import Key, Records
from crux_contracts.scenario import METHODS, load_scenario
from crux_contracts.scenario_types import MAX_SLOPE_DEG
from crux_contracts.yaml_document import DocumentError, Node, parse_mapping, read_bytes

from crux_simulation.benchmarks.random_walls import RUNGS, most_obstacles
from crux_simulation.campaign.job import NOMINAL, ClimbJob, WorldFile
from crux_simulation.campaign.walls import GENERATORS, Wall
from crux_simulation.sim.world import WorldError
from crux_simulation.sim.world_file import read_world

VERSION = 1
MAX_COUNT, MAX_SEED, MAX_ENTRIES = 1_000_000, 2**31 - 1, 1000
MAX_TIME_S = 3600.0
NAME, SEED = Key(type=str), Key(0, MAX_SEED, type=int)
TOP = {
    "version": Key(VERSION, VERSION, required=True, type=int),
    "walls": Key(reader="walls", required=True),
    "name": NAME,
    "worlds": Key(reader="worlds"),
    "seeds": Key(reader="seeds"),
    "methods": Key(reader="methods"),
    "climb": Key(type=bool),
    "time_limit_s": Key(0.0, MAX_TIME_S, "s", above=True, type=float),
}
OF_FILE = {"scenario": Key(reader="scenario", required=True), "name": NAME}
DRAWN = {
    "draw": Key(words=list(GENERATORS), required=True, type=str),
    "count": Key(1, MAX_COUNT, required=True, type=int),
    "name": NAME,
    "first_seed": SEED,
}
SLOPE = {"slope_deg": Key(0.0, MAX_SLOPE_DEG, "deg", type=float)}
LADDER = {"rungs": Key(4, 100, type=int), "steps": Key(1, 1000, type=int), "obstacles": Key(0, type=int)}
SETTINGS: dict[str, dict[str, Key]] = {
    "wall": SLOPE | {"all_limbs": Key(type=bool)}, "ladder": SLOPE | LADDER, "field": {}, "planes": {}, "walk": {}
}  # fmt: skip
"""What a generator takes beside the seed."""


@dataclass(frozen=True)
class Campaign:
    """All of a spec."""

    name: str
    jobs: tuple[ClimbJob, ...]


def read_spec(path: Path) -> Campaign:
    """Raises DocumentError with file, line, key, value and what would be right."""
    reader = _Reader(path)
    spec = reader.keys(TOP, parse_mapping(read_bytes(path), str(path)))
    reader.check.finish(DocumentError)
    worlds, methods = spec.get("worlds", [WorldFile()]), spec.get("methods", [None])
    jobs = [
        ClimbJob(walls, wall, seed, world, method, spec.get("time_limit_s"), spec.get("climb", True))
        for (walls, drawn) in spec["walls"]
        for wall, world, method in itertools.product(drawn, worlds, methods)
        for seed in spec.get("seeds", [wall.seed])
    ]
    return Campaign(spec.get("name", path.stem), tuple({job.key: job for job in jobs}.values()))


class _Reader(Records):
    """Reads a spec; each method reads what a key of that name holds."""

    def __init__(self, path: Path) -> None:
        super().__init__(str(path))
        self.folder = path.parent

    def walls(self, node: Node) -> list[tuple[str, list[Wall]]]:
        """Names and walls of the entries."""
        return [self._entry(each) for each in self._some(node)]

    def worlds(self, node: Node) -> list[WorldFile]:
        """Worlds as planned, or of files."""
        return [self._world(each) for each in self._some(node)]

    def seeds(self, node: Node) -> list[int]:
        """Of noise and worlds."""
        return [self.value(SEED, each) for each in self._some(node)]

    def methods(self, node: Node) -> list[str]:
        """The planner's."""
        return [self.check.choice(each, METHODS) for each in self._some(node)]

    def scenario(self, node: Node) -> Path:
        """A scenario's file."""
        path = self.folder / str(node.content)
        try:
            load_scenario(path)
        except DocumentError as error:
            self.check.note(node, f"expected a scenario file: {str(error).splitlines()[0]}")
        return path

    def _some(self, node: Node) -> list[Node]:
        """Items of a list that has some."""
        if node.content == []:
            self.check.note(node, "expected one entry or more, or no such key")
        return self.check.items(node, MAX_ENTRIES)

    def _world(self, node: Node) -> WorldFile:
        name = self.check.text(node)
        if name == NOMINAL or not name:
            return WorldFile()
        try:
            read_world(self.folder / name)
        except WorldError as error:
            self.check.note(node, f"expected {NOMINAL} or a world file: {str(error).splitlines()[0]}")
            return WorldFile()
        return WorldFile(Path(name).stem, (self.folder / name).read_text(encoding="utf-8"))

    def _entry(self, node: Node) -> tuple[str, list[Wall]]:
        content = node.content if isinstance(node.content, dict) else {}
        wrong = len(self.check.problems)
        if "scenario" in content:
            entry = self.keys(OF_FILE, node)
            if len(self.check.problems) > wrong:
                return "", []
            return entry.get("name", entry["scenario"].stem), [Wall(text=entry["scenario"].read_text(encoding="utf-8"))]
        kind = str(content["draw"].content) if "draw" in content else ""
        settings = dict(SETTINGS.get(kind, {}))
        if "obstacles" in settings:
            rungs = content["rungs"].content if "rungs" in content else RUNGS
            most = most_obstacles(rungs) if isinstance(rungs, int) else MAX_COUNT  # a wrong one is noted by itself
            settings["obstacles"] = replace(settings["obstacles"], high=most)
        entry = self.keys(DRAWN | settings, node)
        if len(self.check.problems) > wrong:
            return "", []
        given = tuple(sorted((name, entry[name]) for name in settings if name in entry))
        first = entry.get("first_seed", 1)
        return entry.get("name", kind), [Wall(kind, seed, given) for seed in range(first, first + entry["count"])]
