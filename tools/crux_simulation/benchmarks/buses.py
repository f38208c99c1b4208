"""`crux bench buses`: what a climb costs in one process and with a runtime of its own, and whether the logs agree."""

from __future__ import annotations

import argparse
from pathlib import Path

from crux_tools.errors import WorkFailed
from crux_tools.output import note, print_json
from mcap.reader import make_reader

from crux_simulation.benchmarks.cold_process import HANGING, measured, planned_scene

CLIMB_LIMIT_S = 300.0
WALL_TIME = "/cycle_timing"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench buses`."""
    parser.add_argument("--scene", default="climb-four-holds", metavar="NAME", help="a shipped scene")
    parser.add_argument("--output", type=Path, default=Path("out/bench-buses"), metavar="DIR", help="for plan and logs")


def messages(log: Path) -> list[tuple[str, int, bytes]]:
    """Everything in a log, in its order, but what carries wall time."""
    with log.open("rb") as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.data) for _, c, m in found if c.topic != WALL_TIME]


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when both logs are the same."""
    planned_scene(options.scene, options.output)
    costs: dict[str, dict[str, float]] = {}
    for bus in ("memory", "udp"):
        log = options.output / f"{bus}.mcap"
        words = ("climb", str(options.output / "plan.mcap"), "-o", str(log), "--bus", bus)
        climb = measured("crux_tools.cli", *words, limit_s=CLIMB_LIMIT_S * HANGING)
        if "cycles" not in climb.result:
            raise WorkFailed(f"--bus {bus}: {climb.result.get('error')}")
        per_cycle_us = climb.cpu_s / climb.result["cycles"] * 1e6
        costs[bus] = {"cpu_us_per_cycle": per_cycle_us, "real_time_factor": climb.result["real_time_factor"]}
    same = messages(options.output / "memory.mcap") == messages(options.output / "udp.mcap")
    ratio = costs["memory"]["cpu_us_per_cycle"] / costs["udp"]["cpu_us_per_cycle"]
    if options.json:
        print_json({"ok": same, "same_log": same, "cpu_ratio": ratio, **costs})
        return 0 if same else 1
    for bus, cost in costs.items():
        note(
            f"{bus:<7} {cost['cpu_us_per_cycle']:6.0f} us of CPU a cycle   {cost['real_time_factor']:5.1f} x real time"
        )
    note(f"ratio   {ratio:6.2f}; logs {'the same' if same else 'DIFFER'} but for {WALL_TIME}")
    return 0 if same else 1
