"""Plans the scenes that ship and writes their figures into docs/benchmarks.md; README.md quotes them.

    python docs/site/benchmarks.py [SCENE ...]    # all that ship

Rows of other scenes, and what stands outside the two comments of the page, stay.
"""

from __future__ import annotations

import re
import sys
import tempfile
from pathlib import Path
from typing import Any

from crux_contracts.output_file import write_whole
from crux_simulation.benchmarks.cold_process import crux_json
from crux_simulation.benchmarks.scenes import scene_names
from crux_simulation.benchmarks.setting import setting
from crux_tools.output import progress
from crux_tools.paths import ROOT, SCENARIOS, version_and_requirements

PAGE = ROOT / "docs" / "benchmarks.md"
BEGIN, END = "<!-- figures of `make benchmarks` -->\n", "<!-- end of these figures -->\n"
HEADS = ("scene", "steps", "J", "gap", "CPU time")


def row(name: str, plan: dict[str, Any]) -> str:
    """A line of the table, of what `crux plan --json` says. Raises SystemExit where there is no plan."""
    if not plan.get("ok"):
        raise SystemExit(f"{name}: {plan.get('error')}: no figures are written")
    gap = plan.get("gap")
    cells = [
        f"`{name}`",
        f"{plan['steps']}",
        f"{plan['cost']:.2f}",
        "" if gap is None else f"{100 * gap:.0f} %",
        f"{plan['computed_s']:.1f} s",
    ]
    return f"| {' | '.join(cells)} |"


def section(rows: dict[str, str]) -> str:
    """The table with the command, the machine, the solvers and the version."""
    said = setting()
    machine, solvers = said["machine"], ", ".join(said["solvers"].values())
    lines = [
        f"`crux plan msgs/scenarios/NAME.yaml -o PLAN.mcap --json` of crux {version_and_requirements()[0]}, with "
        f"{solvers}, on {machine['cpu']}, {machine['cores']} cores. CPU time includes the planner's workers.",
        "",
        f"| {' | '.join(HEADS)} |",
        f"|{' --- |' * len(HEADS)}",
        *(rows[name] for name in sorted(rows)),
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    names = sys.argv[1:] or scene_names()
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    table, after = rest.split(END)
    rows = {match[1]: match[0] for match in re.finditer(r"^\| `([\w-]+)` \|.*$", table, re.MULTILINE)}
    with tempfile.TemporaryDirectory() as folder, progress("planning the scenes", len(names)) as bar:
        for count, name in enumerate(names, 1):
            plan = str(Path(folder) / f"{name}.mcap")
            rows[name] = row(name, crux_json("plan", str(SCENARIOS / f"{name}.yaml"), "-o", plan)[0])
            bar.at(count)
    write_whole(PAGE, f"{before}{BEGIN}{section(rows)}{END}{after}".encode())


if __name__ == "__main__":
    main()
