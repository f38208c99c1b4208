"""`crux bench scenes`: plans, checks and climbs every scene that ships."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_tools.output import note, print_json, progress
from crux_tools.paths import SCENARIOS

from crux_simulation.benchmarks.cold_process import crux_json


@dataclass(frozen=True)
class SceneResult:
    """What became of one scene: what `crux plan`, `check` and `climb` say with --json."""

    name: str
    plan: dict[str, Any]
    cold_s: float  # of `crux plan`, process and all
    check: dict[str, Any]
    climb: dict[str, Any]

    @property
    def ok(self) -> bool:
        """Planned, checked and climbed."""
        return all(bool(part.get("ok")) for part in (self.plan, self.check, self.climb))

    @property
    def remark(self) -> str:
        """Why not; else the gait."""
        why = self.climb.get("reason") or self.climb.get("error") or self.plan.get("error")
        return str(why or " ".join(self.plan.get("gait", [])))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench scenes`."""
    parser.add_argument("scene", nargs="*", help="names of scenes (default: all that ship)")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-scenes"), metavar="DIR", help="for plans and logs"
    )


def scene_names() -> list[str]:
    """Every scene that ships."""
    return sorted(path.stem for path in SCENARIOS.glob("*.yaml"))


def run_scene(name: str, folder: Path) -> SceneResult:
    """Plans, checks and climbs one scene; its plan and log stay in `folder`."""
    plan, log = folder / f"{name}.plan.mcap", folder / f"{name}.log.mcap"
    planned, cold_s = crux_json("plan", str(SCENARIOS / f"{name}.yaml"), "-o", str(plan))
    checked: dict[str, Any] = {}
    climbed: dict[str, Any] = {}
    if planned.get("ok"):
        checked, _ = crux_json("check", str(plan))
        climbed, _ = crux_json("climb", str(plan), "-o", str(log))
    return SceneResult(name, planned, cold_s, checked, climbed)


def _cell(values: dict[str, Any], key: str, scale: float = 1.0, digits: int = 1) -> str:
    value = values.get(key)
    return "-" if value is None else f"{scale * float(value):.{digits}f}"


def _print_table(results: list[SceneResult]) -> None:
    note(
        f"{'scene':<18} {'plan s':>7} {'cold s':>7} {'J':>7} {'check':>6} {'climb':>6} {'goal mm':>8} {'slips':>6} "
        f"{'slip mm':>8} {'body mm':>8} {'force N':>8} {'x real':>7}  gait"
    )
    for result in results:
        plan, climb = result.plan, result.climb
        tracking, goal = climb.get("tracking", {}), climb.get("goal_error", {})
        note(
            f"{result.name:<18} {_cell(plan, 'seconds', digits=2):>7} {result.cold_s:>7.2f} {_cell(plan, 'cost'):>7} "
            f"{'yes' if result.check.get('ok') else 'NO':>6} {'yes' if climb.get('ok') else 'NO':>6} "
            f"{_cell(goal, 'm', 1e3):>8} {_cell(climb, 'slips', digits=0):>6} "
            f"{_cell(climb, 'largest_slip_m', 1e3, 2):>8} {_cell(tracking, 'body_m', 1e3):>8} "
            f"{_cell(tracking, 'force_N', digits=2):>8} {_cell(climb, 'real_time_factor'):>7}  {result.remark}"
        )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every scene was planned, checked and climbed."""
    known = scene_names()
    names = options.scene or known
    for name in names:
        if name not in known:
            note(f"crux bench scenes: {name}: no such scene; there are {', '.join(known)}")
            return 2
    look_at_folder("--output", options.output)
    results: list[SceneResult] = []
    with progress("planning and climbing the scenes", len(names)) as bar:
        for name in names:
            results.append(run_scene(name, options.output))
            bar.at(len(results))
    ok = all(result.ok for result in results)
    if options.json:
        scenes = {
            result.name: {
                "plan": result.plan, "cold_s": result.cold_s, "check": result.check, "climb": result.climb
            } for result in results
        }  # fmt: skip
        print_json({"ok": ok, "scenes": scenes})
    else:
        _print_table(results)
        note(f"{sum(result.ok for result in results)} of {len(results)} scenes climbed; files in {options.output}")
    return 0 if ok else 1
