"""What README.md promises a newcomer."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from crux_contracts.scenario import Scenario, parse_scenario
from crux_tools import cli
from crux_tools.paths import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
OTHER_PAGES = [*ROOT.glob("*/README.md"), ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"]
MAX_PICTURE_BYTES = 400_000


def _example() -> str:
    (example,) = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)
    return str(example)


def test_the_wall_of_the_five_minutes_is_planned_and_checked(tmp_path: Path) -> None:
    scenario, plan = tmp_path / "my-wall.yaml", tmp_path / "my-wall.mcap"
    scenario.write_text(_example(), encoding="utf-8")
    assert cli.main(["plan", str(scenario), "-o", str(plan)]) == 0
    assert cli.main(["check", str(plan)]) == 0


def test_every_key_of_a_scenario_is_explained() -> None:
    table = README.split("| key | means |")[1].split("\n\n")[0]
    sections = {name for name in Scenario.__dataclass_fields__ if name not in {"yaml_text", "path"}} | {"version"}
    assert {name for name in sections if f"`{name}" not in table} == set()
    parse_scenario(_example())


@pytest.mark.parametrize("page", [ROOT / "README.md", *OTHER_PAGES], ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        if not link.startswith("http"):
            assert (page.parent / link).exists(), f"{page.name} links to {link}"


def test_commands_in_the_readme_exist() -> None:
    code = "\n".join(re.findall(r"```.*?```|`[^`\n]+`", README, re.DOTALL))
    named = set(re.findall(r"\bcrux ([a-z-]+)", code))
    assert named
    assert named - set(cli.COMMANDS) == set()
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    asked = set(re.findall(r"\bmake ([a-z-]+)", code))
    assert asked
    assert asked - targets == set()


def test_the_picture_is_small() -> None:
    (picture,) = re.findall(r"!\[[^]]*\]\(([^)]+)\)", README)
    assert (ROOT / picture).stat().st_size < MAX_PICTURE_BYTES
