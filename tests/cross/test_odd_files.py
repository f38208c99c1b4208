"""Files of every kind that a command reads, changed by chance: it reads them, or says what is wrong with them."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import re
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import odd_files as odd
import pytest
from broken_scenarios import SCENARIO
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.checker.certificate import BOUND, NO_PLAN, sealed
from crux_tools import cli
from crux_tools.can import image
from crux_tools.errors import WorkFailed
from crux_tools.log.edit import cut
from crux_tools.report.renderer import NoGraphicsError
from crux_tools.signing_key import new_key
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from made_up_climb import Story, made_up_plan, write_log

EXAMPLES = {"report FILE": 2, "report FILE {log}": 2}  # a page takes its time; 5 of all others
ROOT = Path(__file__).resolve().parents[2]
PHASES = (Phase.generate,)  # what fails is short enough to be read as it is
Change = Callable[[bytes, odd.Draw], bytes]


def _stopped(*_: Any, **__: Any) -> Any:
    """In the place of what a command does once it has read."""
    raise WorkFailed("it has read")


def _no_graphics(*_: Any, **__: Any) -> Any:
    raise NoGraphicsError("no pictures: they take the time of all the rest")


def _made(found: list[Any], *_: Any) -> None:
    """In the place of what plays a log's messages in their time."""
    for each in found:
        each.make()


@dataclass(frozen=True)
class Reader:
    """A command that reads a file, in words: FILE is the changed one (DIR its folder), {name} a good one.

    `instead`: what is called when it has read, as module:name, with what is called in its place.
    """

    words: str
    kind: str
    instead: Mapping[str, Callable[..., Any]] = field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.words} ({self.kind})"


CLIMB = {"crux_simulation.sim.climb:climb": _stopped}
PLAN = {"crux_planner.pipeline.entry:plan": _stopped, "crux_planner.pipeline.replan:Planner": _stopped}
REPLAY = {"crux_tools.replay.recompute:recomputed": _stopped}
SERVE = {"crux_tools.view.command:serve": _stopped}
NO_PICTURES = {"crux_tools.report.pictures:Renderer": _no_graphics}
PLAYER = {
    "lcm:LCM": lambda _url: SimpleNamespace(publish=None),
    "crux_tools.log.lcm_command:_is_somebody_there": lambda _link: False,
    "crux_tools.log.lcm_command:play": _made,
}
READERS = (
    Reader("plan FILE -o OUT", "scenario", PLAN),
    Reader("plan {scenario} --from FILE -o OUT", "plan", PLAN),
    Reader("check {no plan} --scenario FILE", "scenario"),
    Reader("check FILE", "no plan"),
    Reader("check FILE", "bound", {"crux_planner.checker.certificate:CheapestWay": _stopped}),
    Reader("check FILE", "plan"),
    Reader("climb FILE -o OUT", "plan", CLIMB),
    Reader("climb {plan} -o OUT --faults FILE", "faults", CLIMB),
    Reader("climb {plan} -o OUT --drawn-world OUT.yaml --world FILE", "world", CLIMB),
    Reader("sim FILE -o OUT", "plan", {"crux_simulation.sim.practice:_practise": _stopped}),
    Reader("campaign FILE --out OUT", "spec", {"crux_simulation.campaign.cluster:cluster": _stopped}),
    Reader("upload FILE", "plan", {"crux_tools.operator_commands:_link": _stopped}),
    Reader("guide FILE", "plan", {"crux_tools.operator_link:OperatorLink": _stopped}),
    Reader("view FILE", "plan", SERVE),
    Reader("view FILE", "log", SERVE),
    Reader("replay FILE --no-view", "log"),
    Reader("replay FILE --check", "log", REPLAY),
    Reader("replay {log} --check --robot DIR", "robot.yaml", REPLAY),
    Reader("replay {log} --check --robot DIR", "scaler.urdf", REPLAY),
    Reader("report FILE -o OUT", "plan", NO_PICTURES),
    Reader("report FILE -o OUT", "log", NO_PICTURES),
    Reader("report FILE {log} -o OUT", "log", NO_PICTURES),
    Reader("report CAMPAIGN -o OUT", "row", NO_PICTURES),
    Reader("log info FILE", "log"),
    Reader("log ls DIR", "log"),
    Reader("log cut FILE -o OUT --from 0.1", "log"),
    Reader("log merge FILE {log} -o OUT", "log"),
    Reader("log recover FILE -o OUT", "log"),
    Reader("log note FILE words", "log"),
    Reader("log export FILE -o OUT --foxglove", "log"),
    Reader("log export FILE -o OUT --csv", "log"),
    Reader("log export FILE -o OUT --parquet", "log"),
    Reader("log export FILE -o OUT --candump", "log"),
    Reader("log export FILE -o OUT --rerun", "log"),
    Reader("log lcm FILE", "log", PLAYER),
    Reader("key show --key FILE", "key"),
    Reader("can sign FILE --kind joint --firmware-version 0.2.0 --key {key} -o OUT", "elf"),
    Reader("can update LF.joint1 FILE", "image"),
)
CHANGES: dict[str, tuple[Change, ...]] = defaultdict(
    lambda: (odd.other_bytes, odd.other_words, odd.other_yaml),
    {
        "no plan": (odd.other_bytes, odd.other_json, odd.other_certificate, odd.other_certificate),
        "bound": (odd.other_bytes, odd.other_json, odd.other_certificate, odd.other_certificate),
        "plan": (odd.other_bytes, odd.other_plan, odd.other_plan, odd.other_plan),
        "log": (odd.other_bytes, odd.other_log, odd.other_log, odd.other_log),
        "row": (odd.other_bytes, odd.other_json, odd.other_json),
        "scaler.urdf": (odd.other_bytes, odd.other_words),
        "key": (odd.other_bytes, odd.other_words),
        "elf": (odd.other_bytes,),
        "image": (odd.other_bytes,),
    },
)
FAULTS = """version: 1
faults:
  - {kind: cut, limb: RF, at_s: 8.0, for_s: 1.0}
  - {kind: reset, limb: LF, node: 3, at_s: 12.0, for_s: 0.2}
  - {kind: runtime_stopped, at_s: 14.0, for_s: 1.0}
"""
SPEC = f"""version: 1
name: odd
walls:
  - {{draw: wall, count: 3, slope_deg: 45}}
  - {{draw: ladder, count: 1, rungs: 6, steps: 2, obstacles: 1}}
  - {{scenario: {SCENARIO}}}
worlds: [nominal, {ROOT}/tools/worlds/ordinary.yaml]
seeds: [1, 2]
methods: [auto]
time_limit_s: 10
climb: true
"""


def _certificate(claim: str, **more: Any) -> bytes:
    robot = load_robot("scaler")
    return json.dumps(sealed(claim, load_scenario(SCENARIO), robot, **more)).encode()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A good file of every kind."""
    folder = tmp_path_factory.mktemp("good")
    robot = load_robot("scaler").folder
    files = {name: folder / name.replace(" ", "-") for name in {each.kind for each in READERS}}
    write_plan(files["plan"], made_up_plan())
    write_log(folder / "whole", Story(ready_cycles=3, wait_cycles=0, faults=((120, 7, 1),)))
    cut(folder / "whole", files["log"], 1.1, 1.3)
    new_key(files["key"])
    elf = bytearray(b"\x7fELF\1\1" + bytes(46))
    elf[28:32], elf[42:46] = (52).to_bytes(4, "little"), b"\x20\0\1\0"
    elf += b"".join(number.to_bytes(4, "little") for number in (1, 84, 0x8000, 0x8000, 8, 8, 5, 4)) + b"program!"
    files["elf"].write_bytes(elf)
    files["image"].write_bytes(image.sign(b"program", "joint", 0x200, files["key"])[0])
    row = {"walls": "w", "wall_seed": 1, "world": "nominal", "seed": 1, "method": "auto", "key": "k",
           "verdict": "failed", "reason": "2 slips", "plan_s": 1.0, "cost": 3.0}  # fmt: skip
    contents = {
        "scenario": SCENARIO.read_bytes(),
        "no plan": _certificate(NO_PLAN, multipliers=[{"grips": [["left-front-low", "x"]], "of": [[0.0] * 6]}]),
        "bound": _certificate(BOUND, steps=4, bound=0.0, multipliers=[{"knot": None, "of": [[0.0] * 6]}]),
        "faults": FAULTS.encode(),
        "world": (ROOT / "tools/worlds/combined.yaml").read_bytes(),
        "spec": SPEC.encode(),
        "robot.yaml": (robot / "robot.yaml").read_bytes(),
        "scaler.urdf": (robot / "scaler.urdf").read_bytes(),
        "row": json.dumps(row).encode(),
    }
    for name, content in contents.items():
        files[name].write_bytes(content)
    return files


def _words(reader: Reader, folder: Path, good: dict[str, Path]) -> list[str]:
    places = {"FILE": folder / "in" / reader.kind, "DIR": folder / "in", "CAMPAIGN": folder / "campaign",
              "OUT": folder / "out", "OUT.yaml": folder / "out.yaml"}  # fmt: skip
    found = []
    for word in re.findall(r"\{[^}]*\}|\S+", reader.words):
        found.append(str(good[word[1:-1]] if word.startswith("{") else places.get(word, word)))
    return found


def try_file(reader: Reader, data: bytes, folder: Path, good: dict[str, Path]) -> tuple[int, str, str]:
    """Exit status and what is said on standard output and standard error."""
    shutil.rmtree(folder, ignore_errors=True)
    (folder / "in").mkdir(parents=True)
    for name in ("robot.yaml", "scaler.urdf"):
        if reader.kind in ("robot.yaml", "scaler.urdf"):
            shutil.copy(good[name], folder / "in" / name)
    (folder / "in" / reader.kind).write_bytes(data)
    (folder / "in" / reader.kind).chmod(0o600)
    if reader.kind == "log":
        shutil.copy(folder / "in" / reader.kind, folder / "in" / "log.mcap")
    if reader.kind == "row":
        (folder / "campaign/rows").mkdir(parents=True)
        (folder / "campaign/rows/k.json").write_bytes(data)
    printed, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(errors):
        try:
            status = cli.main(_words(reader, folder, good))
        except SystemExit as end:
            raise AssertionError(f"the parser ended it: {errors.getvalue()}") from end
    return status, printed.getvalue(), errors.getvalue()


@contextlib.contextmanager
def ended_after_reading(reader: Reader) -> Iterator[None]:
    """`instead` ends the command."""
    with pytest.MonkeyPatch.context() as patch:
        for place, other in reader.instead.items():
            module, name = place.split(":")
            patch.setattr(importlib.import_module(module), name, other)
        yield


def look(reader: Reader, examples: int, good: dict[str, Path], folder: Path) -> None:
    """Tries so many changed files."""
    whole = good[reader.kind].read_bytes()

    @settings(max_examples=examples, deadline=None, database=None, phases=PHASES)
    @given(data=st.data())
    def changed(data: odd.Draw) -> None:
        change = data.draw(st.sampled_from(CHANGES[reader.kind]))
        status, printed, errors = try_file(reader, change(whole, data), folder, good)
        assert "internal error" not in errors, errors
        assert status == 0 or errors or printed

    with ended_after_reading(reader):
        changed()


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a test may write; the index of logs is its own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "place"


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_odd_files_are_read_or_refused(reader: Reader, good: dict[str, Path], place: Path) -> None:
    """The good one is read, so that a changed one is refused for its change."""
    with ended_after_reading(reader):
        status, _, errors = try_file(reader, good[reader.kind].read_bytes(), place, good)
    if "{no plan}" not in reader.words and reader.words != "check FILE":
        assert status == 0 or "it has read" in errors or "take the robot off the wall" in errors, errors
    look(reader, EXAMPLES.get(reader.words.split(" -o ")[0], 5), good, place)


@pytest.mark.sweep
@pytest.mark.parametrize("reader", READERS, ids=str)
def test_many_odd_files_are_read_or_refused(reader: Reader, good: dict[str, Path], place: Path) -> None:
    look(reader, 100 if reader.words.startswith("report FILE") else 1000, good, place)
