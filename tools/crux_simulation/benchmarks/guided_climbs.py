"""`crux bench guide`: a hold or a sensor fails in each climb, and the guide leads on, or says why it cannot."""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.output_file import look_at_folder
from crux_contracts.robot import load_robot
from crux_contracts.scenario_document import scenario_document
from crux_tools.arguments import whole
from crux_tools.errors import WorkFailed
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS
from crux_tools.report.results import LOG_FILE, Row
from crux_tools.report.statistics import Rate
from crux_tools.telemetry import read_channels

from crux_simulation.benchmarks.worlds import SCENES
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob, WorldFile
from crux_simulation.campaign.walls import Wall

KINDS = {
    "hold-breaks": "holds: {{{hold}: {{breaks_at_s: {at_s:.3f}}}}}",
    "hold-shifted": "holds: {{{hold}: {{offset_m: [{x_m:.4f}, {y_m:.4f}, 0.0]}}}}",
    "slippery-hold": "holds: {{{hold}: {{friction_factor: 0.2}}}}",
    "ft-lost": "sensors: [{{sensor: force_torque, on: {limb}, error: zero, from_s: {at_s:.3f}}}]",
}
SLOPES_DEG = (45.0, 60.0, 75.0, 90.0)  # of the ladders that are drawn, in turn
SHIFT_M = 0.030
NEAR_M = 0.15  # another hold so near is in the limb's reach as well
AT_GOAL_SHARE = 0.9  # of the climbs that had another hold


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench guide`."""
    parser.add_argument(
        "--kinds", nargs="+", choices=KINDS, default=list(KINDS), metavar="KIND", help="not all of them"
    )
    parser.add_argument(
        "--count",
        type=whole(1),
        default=50,
        metavar="N",
        help="drawn ladders of each kind, beside the shipped scenes (default: %(default)s)",
    )
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the first (default: %(default)s)")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-guide"), metavar="DIR", help="for results, and logs of failures"
    )
    add_cluster_options(parser)


@dataclass(frozen=True)
class Mishap:
    """What happens: to a hold that a limb grips in a stance on all of them, or is about to grip."""

    knot: int
    limb: int
    hold: int
    has_other: bool
    """another hold that nobody grips is near"""
    turn_rad: float = 0.0
    """on the wall, of the way that a hold is off"""

    def entry(self, kind: str, at_s: float) -> str:
        """Its line in a world file."""
        return KINDS[kind].format(
            hold=self.hold,
            limb=LIMB_NAMES[self.limb],
            at_s=at_s,
            x_m=SHIFT_M * np.cos(self.turn_rad),
            y_m=SHIFT_M * np.sin(self.turn_rad),
        )


def mishaps(plan: Any, breaks: bool) -> list[Mishap]:
    """All that may happen: a hold that breaks bears a limb before; one that is elsewhere or smooth is not the start's.

    A hold that the goal asks for has no other.
    """
    places = np.array([hold.position_w_m for hold in plan.holds])
    found, start = list[Mishap](), {limb.hold for limb in plan.knots[0].limbs}
    grasps = (scenario_document(plan.scenario_yaml)["goal"].get("grasps") or {}).values()
    wanted = {k for k, hold in enumerate(plan.holds) if hold.name in [grasp["hold"] for grasp in grasps]}
    for k, knot in enumerate(plan.knots[:-1]):
        held = [limb.hold for limb in knot.limbs]
        if min(held) < 0:
            continue
        others = [hold for hold in range(len(places)) if hold not in held]
        for limb, hold in enumerate(held):
            near = np.linalg.norm(places[others] - places[hold], axis=1).min(initial=np.inf) <= NEAR_M
            if breaks or hold not in start:
                found.append(Mishap(k, limb, hold, bool(near and hold not in wanted)))
    return found


@dataclass(frozen=True)
class MishapWorld(WorldFile):
    """A world in which one thing happens, drawn for the plan that is climbed, to a hold with another near if it can."""

    def draw(self, seed: int, plan: Any) -> Any:
        """As of any world file; raises WorldError."""
        mishap = drawn(self.name, seed, plan)
        if mishap is None:
            return None
        at_s = stands_s(plan, mishap.knot, seed) if "{at_s" in KINDS[self.name] else 0.0
        text = f"version: 1\nname: {self.name}\n{mishap.entry(self.name, at_s)}\n"
        return WorldFile(self.name, text).draw(seed, plan)


def drawn(kind: str, seed: int, plan: Any) -> Mishap | None:
    """What happens in the climb of `seed`; None where nothing can."""
    random = np.random.default_rng([seed, list(KINDS).index(kind)])
    may = mishaps(plan, kind in ("hold-breaks", "ft-lost"))
    may = [each for each in may if each.has_other] or may
    if not may:
        return None
    return replace(may[int(random.integers(len(may)))], turn_rad=random.uniform(0.0, 2.0 * np.pi))


def stands_s(plan: Any, knot: int, seed: int) -> float:
    """When a climb of `plan` without mishap has been seen to stand at `knot` on all limbs: simulated time [s].

    The runtime waits for its grasps, so that is later than planned. Raises WorkFailed.
    """
    from crux_simulation.sim.climb import ClimbOptions, climb

    with TemporaryDirectory(prefix="crux-guide-") as folder:
        log = Path(folder) / LOG_FILE
        climb(plan, load_robot(plan.robot_name), log, ClimbOptions(seed=seed))
        state = read_channels(log).tables["/robot_state"]
    stands = np.flatnonzero(state["verified_time_s"] >= plan.knots[knot].time_s)
    if not len(stands):
        raise WorkFailed(f"without mishap the climb does not come to the stance at {plan.knots[knot].time_s:g} s")
    return float(state["time_s"][stands[0]])


@dataclass(frozen=True)
class GuidedJob(ClimbJob):
    """A climb with the guide beside."""

    def climb_command(self) -> str:
        """What climbs so, beside the job's files."""
        return f"{super().climb_command()} --guide"

    def _climb(self, plan: Any, robot: Any, folder: Path) -> dict[str, Any]:
        mishap = drawn(self.walls, self.seed, plan)
        return {**super()._climb(plan, robot, folder), "has_other": bool(mishap and mishap.has_other)}

    def _options(self, world: Any) -> Any:
        from crux_simulation.sim.climb import ClimbOptions

        return ClimbOptions(seed=self.seed, world=world, guide=True)


def jobs_of(kinds: list[str], count: int, first_seed: int) -> list[ClimbJob]:
    """Ladders with a spare hold beside each, whose goal asks for none of them; then the shipped scenes."""
    ladders = [_ladder(first_seed + index, SLOPES_DEG[index % len(SLOPES_DEG)]) for index in range(count)]
    scenes = [Wall(text=(SCENARIOS / f"{name}.yaml").read_text(encoding="utf-8")) for name in SCENES]
    return [
        GuidedJob(kind, wall, first_seed + index, MishapWorld(kind, "drawn for its plan"))
        for kind in kinds
        for index, wall in enumerate(ladders + scenes)
    ]


def _ladder(seed: int, slope_deg: float) -> Wall:
    return Wall("ladder", seed, (("rungs", 5), ("slope_deg", slope_deg), ("spares", True)))


def line_of(rows: list[Row]) -> dict[str, Any]:
    """How the climbs of one kind ended."""
    climbs = [row["climb"] for row in rows]
    stood_s = [time_s for climb in climbs for time_s in climb.get("guide", {}).get("stood_s", [])]
    others = [climb for climb in climbs if climb["has_other"]]
    return {
        "climbs": len(climbs),
        "at_goal": sum(bool(climb["reached_goal"]) for climb in climbs),
        "with_another_hold": len(others),
        "of_these_at_goal": sum(bool(climb["reached_goal"]) for climb in others),
        "slipped": sum(climb["slips"] > 0 for climb in climbs),
        "replanned": sum(climb.get("guide", {}).get("plans", 0) > 0 for climb in climbs),
        "fell": sum(bool(climb["fell"]) for climb in climbs),
        "stood_s": {"median": float(np.median(stood_s)), "most": max(stood_s)} if stood_s else None,
    }


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when nothing fell and 90 % of the climbs with another hold in reach ended at the goal."""
    from crux_simulation.campaign.engine import run_anew

    look_at_folder("--output", options.output)
    jobs = jobs_of(options.kinds, options.count, options.seed)
    kinds: dict[str, list[Row]] = defaultdict(list)
    for row in run_anew(jobs, options.output, options, "climbing with the guide"):
        if "climb" in row:
            kinds[row["walls"]].append(row)
    table = {kind: line_of(rows) for kind, rows in kinds.items()}
    ok = all(
        not line["fell"] and line["of_these_at_goal"] >= AT_GOAL_SHARE * line["with_another_hold"]
        for line in table.values()
    )
    if options.json:
        print_json({"ok": ok, "count": options.count, "kinds": table})
        return 0 if ok else 1
    for kind, line in table.items():
        stood = line["stood_s"]
        waits = f"stood {stood['median']:.1f} s, {stood['most']:.1f} s at most; " if stood else ""
        waits += f"a grip slid in {line['slipped']}; {line['fell']} fell"
        note(
            f"{kind:14} at the goal {Rate(line['of_these_at_goal'], line['with_another_hold'])} with another hold near,"
        )
        note(f"{'':14} {line['at_goal']} of all {line['climbs']}; {line['replanned']} planned again; {waits}")
    note(f"results in {options.output}; crux report {options.output} -o FILE.html shows them")
    return 0 if ok else 1
