"""Figures that pages quote are those that `make benchmarks` wrote into docs/benchmarks.md."""

from __future__ import annotations

import re

from crux_tools.paths import ROOT, SCENARIOS

PAGE = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def rows() -> dict[str, dict[str, str]]:
    """The table of `make benchmarks`: cells of a scene by their heads."""
    table = PAGE.split("<!-- figures of `make benchmarks` -->\n")[1].split("<!-- end of these figures -->\n")[0]
    heads, _, *lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if "|" in line]
    return {cells[0].strip("`"): dict(zip(heads, cells, strict=True)) for cells in lines}


def test_what_was_measured_are_scenes_that_ship() -> None:
    assert set(rows()) <= {path.stem for path in SCENARIOS.glob("*.yaml")}


def test_the_readme_quotes_the_measured_figures() -> None:
    quote = re.search(r"`([\w-]+)` takes (\d+) steps at J = ([\d.]+) with a gap of (\d+ %)", README)
    assert quote
    measured = rows()[quote[1]]
    assert quote.groups()[1:] == (measured["steps"], measured["J"], measured["gap"])
