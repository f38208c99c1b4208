"""What README.md promises a newcomer."""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from crux_contracts.records import keys_of
from crux_contracts.scenario import (
    FACE_NAMES,
    IDLE,
    LIMIT_SURFACES,
    MARGINS,
    METHODS,
    WEIGHTS,
    BodyPose,
    Contact,
    Foothold,
    Goal,
    Grasp,
    Grip,
    Gripper,
    Hold,
    Horizon,
    PlannerOptions,
    Scenario,
    Standing,
    Start,
    Uncertainty,
    Wall,
    parse_scenario,
)
from crux_contracts.scenario_bodies import Bodies, BoxHold, Plane, Pose, Rectangle, Shape, Surface
from crux_tools import cli
from crux_tools.paths import ROOT, SCENARIOS

README = (ROOT / "README.md").read_text(encoding="utf-8")
COMPONENTS = ("msgs", "planner", "runtime", "firmware", "tools", "tests")
OTHER_PAGES = [*(page for component in COMPONENTS for page in sorted((ROOT / component).rglob("*.md")))]
PROJECT_PAGES = ("CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "CODE_OF_CONDUCT.md", "examples/README.md")
OTHER_PAGES += [*(ROOT / page for page in PROJECT_PAGES), *sorted((ROOT / "docs").rglob("*.md"))]
GLOSSARY = ROOT / "docs" / "glossary.md"
PAGES = [ROOT / "README.md", *OTHER_PAGES]
MAX_PICTURE_BYTES = 400_000


def example_wall() -> str:
    """The scenario of the README."""
    (example,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    return str(example)


def test_the_wall_of_the_readme_is_a_scenario() -> None:
    parse_scenario(example_wall())


def test_the_example_of_a_scenario_has_every_key() -> None:
    text = (ROOT / "examples" / "scenario.yaml").read_text(encoding="utf-8")
    assert parse_scenario(text).name == "every-key"
    kinds = (Scenario, Wall, Contact, Hold, Grasp, BodyPose, Gripper, Start, Goal, Horizon, Uncertainty, PlannerOptions)
    fields = {re.sub("_rad$", "_deg", name) for kind in kinds for name in kind.__dataclass_fields__}
    fields -= {"given_w_m_s2", "slabs", "endless", "lean_deg", "tilt_deg", "foot_z_m", "grips", "grip"}
    fields -= {"foothold", "footholds"}  # of version 2, all of these
    keys = (fields | {*WEIGHTS, *MARGINS, *FACE_NAMES, "version", "sigmas", "finger1"}) - {"yaml_text", "path"}
    named = {*re.findall(r"([+\w-]+)(?=: |:\n)", text), *re.findall(r"(?<=# )body(?= sets)", text)}
    assert keys - named == set()
    assert {*METHODS, *LIMIT_SURFACES, *IDLE} - set(re.findall(r"\w+", text)) == set()


def test_the_example_of_version_2_has_every_key_of_it() -> None:
    text = (ROOT / "examples" / "leaning-holds.yaml").read_text(encoding="utf-8")
    assert parse_scenario(text).leans
    keys = {
        name
        for kind in (Bodies, Surface, Plane, Rectangle, BoxHold, Grip, Pose, Shape, Foothold, Standing)
        for name in keys_of(kind)
    }
    assert keys - set(re.findall(r"\w+(?=: |:\n)", text)) == set()


def _code(page: Path) -> str:
    """What stands in code on a page, a line an example."""
    return "\n".join(re.findall(r"```.*?```|`[^`\n]+`", page.read_text(encoding="utf-8"), re.DOTALL))


def _below(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The sub-commands of a command by name."""
    found = [action.choices for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(found[0]) if found else {}


@cache
def _parser(name: str) -> argparse.ArgumentParser:
    command = cli.COMMANDS[name]
    parser = argparse.ArgumentParser()
    getattr(importlib.import_module(command.module), command.adder)(parser.add_subparsers())
    return _below(parser)[name]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_have_the_options_that_pages_name(page: Path) -> None:
    for example in re.findall(r"\bcrux ([a-z][a-z-]*(?: [^`\n]*)?)", _code(page)):
        words = re.split(r" -- | && |[|;#`]", example)[0].split()
        assert words[0] in cli.COMMANDS, f"crux {example}"
        parser = _parser(words[0])
        for word in words[1:]:
            parser = _below(parser).get(word, parser)
        for option in (word.split("=")[0].rstrip(",.:)") for word in words if word.startswith("--")):
            assert option in parser._option_string_actions, f"crux {example}: {option}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_that_pages_name_exist(page: Path) -> None:
    for name in re.findall(rf"(?<![\w/.])((?:{'|'.join(COMPONENTS)})/[\w./*-]+)", _code(page)):
        pattern = name.rstrip("./").replace("NAME", "*") + "*"  # a name may leave its ending out
        beside = [*ROOT.glob(pattern), *page.parent.glob(pattern)]
        assert beside, f"{page.name} names {name}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not link.startswith("http"):
            assert (page.parent / link).exists(), f"{page.name} links to {link}"


def test_what_a_reader_may_copy_has_signs_that_programs_read() -> None:
    """Code, and names of faces anywhere."""
    signs = re.compile("[\N{MINUS SIGN}\N{EN DASH}\N{NO-BREAK SPACE}]")
    face = re.compile(r"\N{MINUS SIGN}[xy]\b")
    copied = [(page.name, line) for page in PAGES for line in _code(page).splitlines() if signs.search(line)]
    copied += [(page.name, hit[0]) for page in PAGES for hit in face.finditer(page.read_text(encoding="utf-8"))]
    assert not copied


def test_commands_in_the_readme_exist() -> None:
    code = _code(ROOT / "README.md")
    named = set(re.findall(r"\bcrux ([a-z-]+)", code))
    assert named
    assert named - set(cli.COMMANDS) == set()
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    asked = set(re.findall(r"\bmake ([a-z-]+)", code))
    assert asked
    assert asked - targets == set()


def _helps(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, str]]:
    """The help of a command and of the commands below it."""
    texts = [parser.description, parser.epilog, *(action.help for action in parser._actions)]
    yield name, "\n".join(filter(None, texts))
    for below, child in _below(parser).items():
        yield from _helps(f"{name} {below}", child)


def test_pages_and_help_keep_to_the_words_of_the_glossary() -> None:
    rows = GLOSSARY.read_text(encoding="utf-8").split("| write | not |")[1].splitlines()[2:]
    avoided = [word.strip() for row in rows for word in row.split("|")[2].split(",")]
    assert "room" in avoided
    texts = [
        (page.name, re.sub(r"```.*?```|`[^`]*`|\]\([^)]*\)", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL))
        for page in PAGES
        if page != GLOSSARY
    ]
    texts += [found for name in cli.COMMANDS for found in _helps(f"crux {name}", _parser(name))]
    texts += [("crux", text) for text in (command.help for command in cli.COMMANDS.values())]
    wrong = re.compile(rf"(?i)(?<!crux )\b({'|'.join(map(re.escape, avoided))})\b")  # but the command crux bench
    found = [f"{where}: {hit[0]}" for where, text in texts for hit in wrong.finditer(text)]
    assert not found, "docs/glossary.md says what to write"


def test_every_scene_and_every_component_has_its_word() -> None:
    scenes = (ROOT / "msgs" / "README.md").read_text(encoding="utf-8").split("| scene | is |")[1].split("\n\n")[0]
    assert {path.stem for path in SCENARIOS.glob("*.yaml")} == set(re.findall(r"`([a-z-]+)`", scenes))
    assert {page.parent.name for page in OTHER_PAGES if page.name == "README.md"} >= set(COMPONENTS)


def test_the_readme_begins_with_a_climb_and_the_data_flow_in_small_files() -> None:
    pictures = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README.split("\n## ")[0])
    assert pictures == ["tools/pictures/climb.png", "docs/data-flow.svg"]
    assert sum((ROOT / picture).stat().st_size for picture in pictures) < MAX_PICTURE_BYTES
