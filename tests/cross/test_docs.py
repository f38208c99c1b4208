"""The docs site: what it says of itself, and that it can be made (where `make docs` has installed its generator)."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from crux_tools import cli
from crux_tools.paths import ROOT

SOURCES = ("planner", "runtime", "firmware", "tools", "msgs")
READERS = ["Plan a climb", "Operate a robot", "Find a cause", "Change crux"]
GENERATOR = ROOT / ".venv-docs" / "bin" / "python"
CITED = re.compile(r"(?:(?i:equations?|of|and|to|by|satisf\w+|bounds?|under)) \((\d+[a-c]?)\)")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("docs") / "source"
    subprocess.run([sys.executable, ROOT / "docs" / "site" / "pages.py", folder], check=True)
    return folder


def test_every_equation_that_code_cites_is_explained() -> None:
    explained = (ROOT / "docs" / "mathematics.md").read_text(encoding="utf-8")
    cited: dict[str, Path] = {}
    for folder in SOURCES:
        for path in (ROOT / folder).rglob("*"):
            if path.suffix in {".py", ".hpp", ".cpp", ".h", ".c"}:
                cited |= dict.fromkeys(CITED.findall(path.read_text(encoding="utf-8")), path)
    assert {"2", "8b", "9a", "14", "19a"} <= set(cited)
    missing = {number: path for number, path in cited.items() if f"({number})" not in explained}
    assert not missing


def test_every_fault_has_its_page(pages: Path) -> None:
    for fault in yaml.safe_load((ROOT / "msgs" / "faults.yaml").read_text(encoding="utf-8"))["faults"]:
        page = (pages / "faults" / f"{fault['name']}.md").read_text(encoding="utf-8")
        for key in ("text", "cause", "do"):
            assert fault[key][1:] in page
        assert f"[{fault['name']}]({fault['name']}.md)" in (pages / "faults" / "index.md").read_text(encoding="utf-8")


def test_every_key_of_a_scenario_is_explained(pages: Path) -> None:
    page = (pages / "scenario-keys.md").read_text(encoding="utf-8")
    example = (ROOT / "examples" / "scenario.yaml").read_text(encoding="utf-8")
    for key in re.findall(r"^ *(?:- )?(?:# )?([a-z]\w+):", example, re.MULTILINE):
        assert key == "version" or re.search(rf"^\| `{key}` \| .+ \| \S.*\. \|$", page, re.MULTILINE), key
    assert "| `tolerance_m` | number from 0.0005 to 0.2 m | 0.01 | " in page


def test_every_key_of_a_robot_is_explained(pages: Path) -> None:
    page = (pages / "robot-keys.md").read_text(encoding="utf-8")
    robot = yaml.safe_load((ROOT / "msgs" / "robots" / "scaler" / "robot.yaml").read_text(encoding="utf-8"))
    robot["limbs"] = robot["limbs"]["LF"]
    for section, values in robot.items():
        about = page if not isinstance(values, dict) else page.partition(f"## {section}\n")[2].partition("\n## ")[0]
        for key, value in values.items() if isinstance(values, dict) else [(section, values)]:
            row = rf"^\| `{key}` \| .+ \| \w.+ \| {re.escape(str(value))}( \[[SCA]\])? \|$"
            assert re.search(row, about, re.MULTILINE), key
    assert "| `dead_time_s` | number from 0 s | " in page
    assert "0.004 [A] |" in page


def test_commands_and_frames_are_all_there(pages: Path) -> None:
    commands = (pages / "commands.md").read_text(encoding="utf-8")
    for name, command in cli.COMMANDS.items():
        assert f"## crux {name}\n" in commands, command
        assert f"usage: crux {name}" in commands
    frames = (pages / "can" / "frames.md").read_text(encoding="utf-8")
    signals = set(re.findall(r"^ SG_ (\w+)", (ROOT / "msgs" / "can" / "crux.dbc").read_text(), re.MULTILINE))
    assert {name for name in signals if f"`{name}`" not in frames} == set()


def test_what_pages_include_begins_and_ends_at_words_that_are_there(pages: Path) -> None:
    included = re.findall(
        r"^```\{include\} (\S+)\n((?::.*\n)*)", (pages / "index.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert included
    for source, options in included:
        text = (pages / source).read_text(encoding="utf-8")
        for words in re.findall(r'^:(?:start-after|end-before): "(.*)"$', options, re.MULTILINE):
            assert text.count(words.replace("\\n", "\n")) == 1, (source, words)


@pytest.mark.skipif(not GENERATOR.exists(), reason="make docs has not installed its generator")
@pytest.mark.sweep  # `make docs` stops at a warning, too
def test_the_site_has_no_warning_and_needs_no_network(pages: Path, tmp_path: Path) -> None:
    words = [GENERATOR, "-m", "sphinx", "-q", "-W", "--keep-going", "-c", ROOT / "docs" / "site", pages, tmp_path]
    environment = {"PYTHONPATH": ":".join(filter(None, sys.path)), "PATH": "/usr/bin:/bin"}
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    landing = (tmp_path / "index.html").read_text(encoding="utf-8")
    for shown in ("climb.png", "data-flow.svg", "landing.css"):
        assert re.search(rf'(?:src|href)="[^"]*{re.escape(shown)}', landing), shown
    assert re.findall(r'<div class="reader[^"]*">\s*<p><strong>([^<]+)', landing) == READERS
    assert "make climb" in re.sub(r"<[^>]+>", "", landing)
    for page in tmp_path.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert not re.search(r"<(?:script|img|iframe)[^>]* src=\"(?:https?:)?//", text), page.name
        assert not re.search(r"<link[^>]* href=\"(?:https?:)?//", text), page.name
