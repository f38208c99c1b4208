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
from typing import Any

from crux_contracts.reading import Checker
from crux_contracts.records import Key, Records
from crux_contracts.scenario import METHODS, load_scenario
from crux_contracts.yaml_document import DocumentError, Node, parse_mapping, read_bytes

from crux_simulation.benchmarks.random_walls import RUNGS, most_obstacles
from crux_simulation.campaign.job import NOMINAL, ClimbJob, WorldFile
from crux_simulation.campaign.walls import GENERATORS, Wall
from crux_simulation.sim.world import WorldError
from crux_simulation.sim.world_file import read_world

VERSION = 1
MAX_COUNT, MAX_SEED, MAX_ENTRIES = 1_000_000, 2**31 - 1, 1000
MAX_TIME_S = 3600.0
SLOPE = {"slope_deg": Key(0.0, 110.0, "deg", type=float)}
LADDER = {"rungs": Key(4, 100, type=int), "steps": Key(1, 1000, type=int), "obstacles": Key(0, type=int)}
SETTINGS: dict[str, dict[str, Key]] = {
    "wall": SLOPE | {"all_limbs": Key(type=bool)}, "ladder": SLOPE | LADDER, "field": {}, "walk": {}
}  # fmt: skip
"""What a generator takes beside the seed."""


@dataclass(frozen=True)
class Campaign:
    """All of a spec."""

    name: str
    jobs: tuple[ClimbJob, ...]


def read_spec(path: Path) -> Campaign:
    """Raises DocumentError with file, line, key, value and what would be right."""
    records = Records(str(path))
    check = records.check
    root = check.members(
        parse_mapping(read_bytes(path), str(path)),
        ("version", "walls"),
        ("name", "worlds", "seeds", "methods", "climb", "time_limit_s"),
    )
    if "version" in root:
        check.integer(root["version"], VERSION, VERSION)
    name = check.text(root["name"]) if "name" in root else path.stem
    entries = [_walls(records, node, path.parent) for node in _some(check, root.get("walls"))]
    worlds = [_world(check, node, path.parent) for node in _some(check, root.get("worlds"))] or [WorldFile()]
    seeds = [check.integer(node, 0, MAX_SEED) for node in _some(check, root.get("seeds"))]
    methods: list[str | None] = [check.choice(node, METHODS) for node in _some(check, root.get("methods"))]
    climbs = check.flag(root["climb"]) if "climb" in root else True
    limit_s = check.number(root["time_limit_s"], 0.0, MAX_TIME_S, "s", above=True) if "time_limit_s" in root else None
    check.finish(DocumentError)
    jobs = [
        ClimbJob(walls, wall, seed, world, method, limit_s, climbs)
        for (walls, drawn) in entries
        for wall, world, method in itertools.product(drawn, worlds, methods or [None])
        for seed in seeds or [wall.seed]
    ]
    return Campaign(name, tuple({job.key: job for job in jobs}.values()))


def _some(check: Checker, node: Node | None) -> list[Node]:
    """Items of a list that is there, and then has some."""
    if node is None:
        return []
    if node.content == []:
        check.note(node, "expected one entry or more, or no such key")
    return check.items(node, MAX_ENTRIES)


def _world(check: Checker, node: Node, folder: Path) -> WorldFile:
    """The world as planned, or one of a file."""
    name = check.text(node)
    if name == NOMINAL or not name:
        return WorldFile()
    try:
        read_world(folder / name)
    except WorldError as error:
        check.note(node, f"expected {NOMINAL} or a world file: {str(error).splitlines()[0]}")
        return WorldFile()
    return WorldFile(Path(name).stem, (folder / name).read_text(encoding="utf-8"))


def _walls(records: Records, node: Node, folder: Path) -> tuple[str, list[Wall]]:
    """Name and walls of one entry."""
    check = records.check
    content = node.content if isinstance(node.content, dict) else {}
    if "scenario" in content:
        return _scenario_file(check, node, folder)
    kind_node = content.get("draw")
    kind = kind_node.content if kind_node is not None and isinstance(kind_node.content, str) else ""
    known = check.members(node, ("draw", "count"), ("name", "first_seed", *SETTINGS.get(kind, ())))
    if "draw" in known:
        check.choice(known["draw"], list(GENERATORS))
    count = check.integer(known["count"], 1, MAX_COUNT) if "count" in known else 0
    first = check.integer(known["first_seed"], 0, MAX_SEED) if "first_seed" in known else 1
    settings: dict[str, Any] = {}
    for setting, key in SETTINGS.get(kind, {}).items():
        if setting == "obstacles":
            key = replace(key, high=most_obstacles(settings.get("rungs", RUNGS)))  # noqa: PLW2901
        if setting in known:
            settings[setting] = records.value(key, known[setting])
    name = check.text(known["name"]) if "name" in known else kind
    return name, [Wall(kind, seed, tuple(sorted(settings.items()))) for seed in range(first, first + count)]


def _scenario_file(check: Checker, node: Node, folder: Path) -> tuple[str, list[Wall]]:
    known = check.members(node, ("scenario",), ("name",))
    path = folder / str(known["scenario"].content)
    try:
        load_scenario(path)
    except DocumentError as error:
        check.note(known["scenario"], f"expected a scenario file: {str(error).splitlines()[0]}")
        return "", []
    name = check.text(known["name"]) if "name" in known else path.stem
    return name, [Wall(text=path.read_text(encoding="utf-8"))]
