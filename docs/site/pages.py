"""Lays out the sources of the docs site: the repository's pages, and pages made of READMEs and tables.

    python docs/site/pages.py build/docs-source

The layout is the repository's own, so links between its pages lead to the same places on the site.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import math
import re
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import MISSING, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin

import yaml
from crux_contracts import can_codec, node_parameters
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.records import Key, keys_of
from crux_contracts.robot import ROBOTS
from crux_contracts.scenario import (
    Contact,
    Goal,
    GoalPose,
    Grasp,
    Gripper,
    Hold,
    Horizon,
    PlannerOptions,
    Scenario,
    Start,
    Uncertainty,
    Wall,
)
from crux_msgs.robot_keys import SECTIONS, InUrdf, OfLimb, Top
from crux_tools import cli
from crux_tools.paths import ROOT

COPIED = ["docs", "examples", "firmware", "msgs", "planner", "runtime", "tests", "tools"]
COPIED += ["CHANGELOG.md", "CONTRIBUTING.md", "LICENSE", "NOTICE", "README.md", "SECURITY.md", "CODE_OF_CONDUCT.md"]
HEADERS = ("runtime/core", "runtime/bus", "runtime/exchange", "firmware/core", "firmware/safety")


def section(page: str, title: str) -> str:
    """The text of a section of a page of the repository, without its heading."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.search(rf"^(#+) {re.escape(title)}\n(.*?)(?=^#{{1,2}} |\Z)", text, re.MULTILINE | re.DOTALL)
    if not found:
        raise SystemExit(f"{page} has no section {title!r}, which the docs site shows")
    return found[2].strip()


def table(heads: tuple[str, ...], rows: Sequence[tuple[Any, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join(f"| {' | '.join(str(cell).replace('|', chr(92) + '|') for cell in line)} |" for line in lines)


def fault_pages() -> Iterator[tuple[str, str]]:
    """A page a fault of msgs/faults.yaml, and one that lists them."""
    faults = yaml.safe_load((ROOT / "msgs" / "faults.yaml").read_text(encoding="utf-8"))["faults"]
    rows = []
    for fault in faults:
        name, code = fault["name"], fault["code"]
        assert FAULT_BY_CODE[code].name == name
        told = fault["to"] == "CLIMBING"
        after = "It is told only; the robot climbs on." if told else f"The runtime goes to **{fault['to']}**."
        if fault.get("recovers"):
            after += " When all is well again it goes back by itself: to READY, or to HOLDING, never to CLIMBING."
        body = f"# {code}: {name}\n\n> {fault['text']}\n\n## What happens\n{after}\n\n## What usually is behind it\n"
        body += f"{_sentence(fault['cause'])}\n\n## What to do\n{_sentence(fault['do'])}\n\n"
        body += "`crux status` shows which limb and node it is, since when, and {value} and {limit}.\n"
        yield f"faults/{name}.md", body
        rows.append((code, f"[{name}]({name}.md)", fault["to"], fault["text"]))
    listed = "\n".join(f"{fault['name']}" for fault in faults)
    intro = "# Faults\nEvery reason for which the runtime leaves READY or CLIMBING, or has something to tell.\n\n"
    toctree = f"\n\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"
    yield "faults/index.md", intro + table(("number", "name", "state that follows", "text"), rows) + toctree


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."


def can_pages() -> Iterator[tuple[str, str]]:
    """The CAN database and the nodes' parameters as tables."""
    text = "# CAN frames\nFrom `msgs/can/crux.dbc`; what they are for: [CAN protocol](../msgs/can/README.md).\n"
    for message in sorted(can_codec.database().messages, key=lambda each: each.frame_id):
        if re.match(r"Joint[2-6]", message.name):
            continue  # as Joint1
        alike = "; the other joints' follow it, one identifier apart" if message.name.startswith("Joint1") else ""
        text += f"\n## {message.name}\nIdentifier 0x{message.frame_id:03X}, {message.length} bytes{alike}.\n\n"
        rows = [
            (f"`{s.name}`", s.start, s.length, "float" if s.is_float else s.scale, s.unit or "", _choices(s))
            for s in message.signals
        ]
        text += table(("signal", "first bit", "bits", "step", "unit", "values"), rows) + "\n"
    yield "can/frames.md", text
    text = "# Parameters of the nodes\n`crux can param` lists and writes them; see [services](../msgs/can/README.md).\n"
    for kind, parameters in node_parameters.table().items():
        lines = [(p.id, f"`{p.name}`", p.unit, p.means) for p in parameters]
        text += f"\n## {kind}\n" + table(("id", "name", "unit", "means"), lines) + "\n"
    yield "can/parameters.md", text


def _choices(signal: Any) -> str:
    return ", ".join(f"{number} {name}" for number, name in (signal.choices or {}).items())


def robot_page() -> Iterator[tuple[str, str]]:
    """Every key of robot.yaml, with what it is for scaler."""
    file = ROBOTS / "scaler" / "robot.yaml"
    scaler = yaml.safe_load(file.read_text(encoding="utf-8"))
    marks = _marks(file)
    text = "# Keys of robot.yaml\nEvery key without a default must be there; unknown keys are refused. "
    text += "[Your robot](docs/your-robot.md) says how to begin. The last column is what `scaler` has, or the default: "
    text += "[S] read at a source, [C] computed, [A] assumed.\n"
    for section, kind in ({"": Top, "limbs": OfLimb, "limb": InUrdf} | SECTIONS).items():
        text += f"\n## {section}\n{kind.__doc__}\n\n" if section else "\n"
        values = {"": scaler, "limbs": scaler["limbs"]["LF"]}.get(section) or scaler.get(section, {})
        rows = []
        for name, key in keys_of(kind).items():
            mark = marks.get(f"{section}.{name}") or marks.get(section, "")
            holds = _holds(key).replace("2 numbers", "[low, high]")
            value = values[name] if name in values else f"{_default(key.default)} by default"
            rows.append((f"`{name}`", holds, _sentence(key.means), f"{value} {mark}".strip()))
        text += table(("key", "holds", "means", "scaler"), rows) + "\n"
    yield "robot-keys.md", text


def scenario_page() -> Iterator[tuple[str, str]]:
    """Every key of a scenario."""
    text = "# Keys of a scenario\nUnknown keys are refused. [examples/scenario.yaml](examples/scenario.yaml) has all.\n"
    parts = {"wall": Wall, "contact": Contact, "holds, obstacles": Hold, "start": Start, "air": Gripper, "goal": Goal}
    parts |= {"body": GoalPose, "grasps": Grasp, "horizon": Horizon, "uncertainty": Uncertainty}
    for part, kind in ({"": Scenario} | parts | {"planner": PlannerOptions}).items():
        text += f"\n## {part}\n\n" if part else "\n"
        rows = [
            (f"`{name}`", _holds(key), "" if key.required else _default(key.default), _sentence(key.means))
            for name, key in keys_of(kind).items()
        ]
        text += table(("key", "holds", "default", "means"), rows) + "\n"
    yield "scenario-keys.md", text


def _default(value: Any) -> str:
    value = value[0] if isinstance(value, tuple) and len(set(value)) == 1 else value  # of each
    return "none" if value in (None, (), MISSING) or is_dataclass(value) else str(value).lower()


def _holds(key: Key) -> str:
    """Type, range and unit."""
    parts = [part for part in get_args(key.type) if part is not type(None)]
    least = "above 0" if key.above or 0 < key.low < 1e-6 else f"from {key.low:g}"
    bounds = f" {least}{f' to {key.high:g}' if key.high < 1e9 else ''}" if math.isfinite(key.low) else ""
    bounds = f"{bounds} {key.unit}".rstrip()
    if key.words:
        return " or ".join(key.words) if get_origin(key.type) is not dict else f"by {', '.join(key.words)}"
    if key.reader in ("nodes", "joints", "finger_joints", "file"):
        return {"nodes": "a number for each name", "file": "file name"}.get(key.reader, "names")
    if get_origin(key.type) is tuple and float in parts and ... not in parts:
        return f"{len(parts)} numbers{bounds}"
    if is_dataclass(parts[0] if parts else key.type):
        return "list" if parts and ... in parts else "mapping"
    kind = parts[0] if parts else key.type
    return "text" if kind is str else {float: "number", int: "integer"}.get(kind, "true or false") + bounds


def _marks(file: Path) -> dict[str, str]:
    """Marks of a robot.yaml's comments by section.key, or by section where they are for all its keys."""
    marks, section = {}, ""
    for line in file.read_text(encoding="utf-8").splitlines():
        named, mark = re.match(r"( *)(\w+):", line), re.search(r"\[([SCA])\b", line)
        if named and not named[1]:
            section = named[2]
        if named and mark:
            marks[f"{section}.{named[2]}" if named[1] else section] = f"[{mark[1]}]"
    return marks


def command_page() -> Iterator[tuple[str, str]]:
    """What `--help` says of every command."""
    text = "# Commands\nWhat `--help` says. Exit status 0: done; 1: the work failed; 2: the input was wrong.\n"
    for name in cli.COMMANDS:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
            cli.main([name, "--help"])
        text += f"\n## crux {name}\n```text\n{said.getvalue().strip()}\n```\n"
    yield "commands.md", text


def header_page() -> Iterator[tuple[str, str]]:
    """The first comment of every C and C++ header of the control core and the nodes."""
    text = "# C and C++ headers\nWhat each header says of itself; its functions are described in it.\n"
    for folder in HEADERS:
        rows = []
        for path in sorted([*(ROOT / folder).rglob("*.h"), *(ROOT / folder).rglob("*.hpp")]):
            comment = re.match(r"(?:///? ?[^\n]*\n)+", path.read_text(encoding="utf-8"))
            if comment:
                words = " ".join(line.lstrip("/").strip() for line in comment[0].splitlines())
                name = path.relative_to(ROOT / folder).as_posix()
                rows.append((f"[`{name}`]({folder}/{name})", re.sub(r"([*_<>$\[\]])", r"\\\1", words)))
        text += f"\n## {folder}\n" + table(("header", "is for"), rows) + "\n"
    yield "headers.md", text


def composed_pages() -> Iterator[tuple[str, str]]:
    """Sections of READMEs as pages of their own."""
    wall, real = "Your own wall in five minutes", "The real robot"
    yield "wall.md", f"# Your wall\n{section('README.md', wall)}\n"
    runtime = section("tools/README.md", "A runtime on the robot")
    runtime = runtime.replace("](../", "](").replace("](#the-guide)", "](tools/README.md#the-guide)")
    yield "real-robot.md", f"# The real robot\n{section('README.md', real)}\n\n## The commands in detail\n{runtime}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="lays out the sources of the docs site")
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    shutil.copy(ROOT / "docs" / "site" / "index.txt", folder / "index.md")
    tables = (fault_pages(), can_pages(), robot_page(), scenario_page())
    for pages in (*tables, command_page(), header_page(), composed_pages()):
        for name, text in pages:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
