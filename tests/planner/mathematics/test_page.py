"""The page itself: every equation has a test, every symbol one meaning, and its figures are those of the code."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from crux_contracts.cost_weights import CLIMB, WALK
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.checker.limit_surface import DISC_POWER
from crux_planner.model.build import MOST_FRICTION
from crux_planner.physics.limit_surface import SMOOTHING_N
from crux_tools.paths import ROOT
from shared_plans import SharedPlans

PAGE = (ROOT / "docs" / "mathematics.md").read_text(encoding="utf-8")
DISPLAYED = re.findall(r"\$\$(.+?)\$\$", PAGE, re.DOTALL)


def test_every_displayed_equation_has_a_number_and_a_test() -> None:
    numbered = [re.match(r"\\text\{\((\w+)\)\} \\quad ", shown) for shown in DISPLAYED]
    assert [shown for shown, number in zip(DISPLAYED, numbered, strict=True) if number is None] == []
    numbers = [number[1].lower() for number in numbered if number]
    assert len(numbers) == len(set(numbers)) > 25
    tested: set[str] = set()
    for path in Path(__file__).parent.glob("test_*.py"):
        tested |= set(re.findall(r"^def test_equation_([0-9a-z]+)_", path.read_text(encoding="utf-8"), re.MULTILINE))
    assert tested == set(numbers)


def test_every_number_that_the_text_has_is_displayed() -> None:
    """(8), (9), (10) and (19) stand for all their parts."""
    shown = set(re.findall(r"\\text\{\((\w+)\)\}", PAGE)) | {"8", "9", "10", "19"}
    assert set(re.findall(r"\((C?\d+[a-c]?)\)", re.sub(r"\$[^$]*\$", "", PAGE))) <= shown


def test_every_symbol_is_in_the_notation_once() -> None:
    notation = PAGE[PAGE.index("## Notation") : PAGE.index("## Contact")]
    rows = re.findall(r"^\| (\$.+?) \| .* \|$", notation, re.MULTILINE)
    symbols = [symbol for row in rows for symbol in re.findall(r"\$([^$]+)\$", row)]
    assert len(symbols) == len(set(symbols)) > 60
    greek = "lambda|tau|theta|omega|psi|alpha|beta|gamma|mu|sigma|kappa|eta|delta|epsilon|rho|zeta|xi|nu|varphi|chi"
    known = re.compile(rf"\\(?:{greek}|Delta|ell)(?![a-z])")
    used = {symbol for shown in DISPLAYED for symbol in known.findall(shown)}
    assert len(used) > 15
    assert {symbol for symbol in used if symbol not in " ".join(symbols)} == set()


def test_the_figures_between_the_knots_are_those_of_the_shipped_climb(planned: SharedPlans) -> None:
    robot = load_robot("scaler")
    report = planned(load_scenario(ROOT / "msgs" / "scenarios" / "climb-four-holds.yaml"), robot).check
    said = re.search(r"ship (\d+) to (\d+) N m, for which the controller adds (\d+) to (\d+) N to", PAGE)
    assert said
    assert report.correction is not None
    assert float(said[1]) < report.correction.moment_Nm < float(said[2])
    assert float(said[3]) < report.correction.force_N < float(said[4])
    words = r"largest speed, ([\d.]+) m/s, for \$dt\$ = (\d) s, its weight makes a moment of ([\d.]+) N m"
    speed = re.search(words, PAGE)
    assert speed
    assert float(speed[1]) == robot.body.max_speed_m_s
    assert f"{robot.total_mass_kg * 9.81 * float(speed[1]) * float(speed[2]):.1f}" == speed[3]


def test_numbers_of_the_page_are_those_of_the_code() -> None:
    """Weights of J, and of (2) and (2a)."""
    for name in ("position", "orientation", "velocity", "wrench", "lift", "opening", "switching"):
        said = re.search(rf"`{name}`(?: \$= -\\\w+ =\$)? ([\d.]+(?:⁻⁴)?)", PAGE)
        assert said, name
        assert float(said[1].replace("10⁻⁴", "1e-4")) == getattr(CLIMB, name)
    walks = re.search(r"Walks have other default weights: (.+?)\.\s", PAGE)
    assert walks
    different = {name: float(value) for name, value in re.findall(r"`(\w+)` ([\d.]+)", walks[1])}
    assert replace(CLIMB, **different) == WALK
    assert f"no more than {100 * MOST_FRICTION:.1f} % of it" in PAGE
    assert f"{{1/{DISC_POWER}}} \\le" in PAGE
    assert f"({SMOOTHING_N}\\ \\text{{N}})^2" in PAGE
