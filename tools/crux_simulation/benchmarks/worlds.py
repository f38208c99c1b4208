"""`crux bench worlds`: shipped scenes and random walls, or walls like a given one, climbed in worlds with all ordinary
errors at once.
"""

from __future__ import annotations

import argparse
import shlex
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario import load_scenario
from crux_tools.arguments import whole
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS, WORLDS
from crux_tools.report.results import CLIMBED, FAILED, Row
from crux_tools.report.statistics import Rate

from crux_simulation.benchmarks.like_walls import wall_like
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob, WorldFile
from crux_simulation.campaign.walls import Wall

WORLD = WORLDS / "ordinary.yaml"
SCENES = ("climb-four-holds", "climb-one-step", "climb-slippery", "climb-vertical", "climb-overhang", "climb-obstacles")
AT_GOAL_SHARE = 0.97


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench worlds`."""
    parser.add_argument("--count", type=whole(1), default=100, metavar="N", help="climbs (default: %(default)s)")
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="of the first wall and world (default: %(default)s)"
    )
    add_like_option(parser)
    parser.add_argument("--world", type=Path, default=WORLD, metavar="FILE.yaml", help="drawn from (default: ordinary)")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-worlds"), metavar="DIR", help="for results, and logs of failures"
    )
    add_cluster_options(parser)


def add_like_option(parser: argparse.ArgumentParser) -> None:
    """`--like`, of benches that climb shipped scenes and random walls by turns."""
    parser.add_argument(
        "--like", type=Path, metavar="FILE.yaml",
        help="in place of shipped scenes and random walls, this scenario's robot and wall, its holds scattered anew "
        "for each climb",
    )  # fmt: skip


@dataclass(frozen=True)
class Walls:
    """What is climbed: shipped scenes and random walls by turns, or walls like that of a scenario file."""

    like: Path | None = None
    """raises ScenarioError where it is no scenario"""
    objective: str | None = None
    """that they are planned for; None: as they say"""

    def __post_init__(self) -> None:
        if self.like is not None:
            load_scenario(self.like)

    def of(self, index: int, seed: int) -> Wall:
        """The same wall for the same numbers."""
        if self.like is not None:
            drawn = Wall(seed=seed, text=wall_like(seed, text=self.like.read_text(encoding="utf-8")))
        elif index % 2 == 1:
            drawn = Wall("wall", seed, (("all_limbs", True), ("slope_deg", 45.0)))
        else:
            drawn = Wall(text=(SCENARIOS / f"{SCENES[index // 2 % len(SCENES)]}.yaml").read_text(encoding="utf-8"))
        return drawn.planned(objective=self.objective)

    def words(self) -> str:
        """The options of a bench that ask for them."""
        asked = {"like": self.like and self.like.resolve(), "objective": self.objective}
        return "".join(f" --{name} {shlex.quote(str(value))}" for name, value in asked.items() if value)


USUAL = Walls()


def jobs_of(count: int, first_seed: int, world: WorldFile, walls: Walls = USUAL) -> list[ClimbJob]:
    """Each wall in a world of its own."""
    drawn = [walls.of(index, first_seed + index) for index in range(count)]
    kinds = [walls.like.stem if walls.like else "random wall" if wall.kind else "shipped scene" for wall in drawn]
    return [
        ClimbJob(kind, wall, first_seed + index, world)
        for index, (kind, wall) in enumerate(zip(kinds, drawn, strict=True))
    ]


def fell(row: Row) -> bool:
    """The robot did not only miss its goal."""
    return bool(row.get("climb", {}).get("fell"))


def lost_grip(row: Row) -> bool:
    """A limb lost its hold in stance, whether the others held the robot or not."""
    return bool(row.get("climb", {}).get("lost_grips"))


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when nothing fell, no grip was lost and 97 % of the climbs ended at the goal."""
    from crux_simulation.campaign.engine import run_anew
    from crux_simulation.sim.world_file import read_world

    spec = read_world(options.world)
    look_at_folder("--output", options.output)
    world = WorldFile(spec.name, options.world.read_text(encoding="utf-8"))
    jobs = jobs_of(options.count, options.seed, world, Walls(options.like))
    rows = run_anew(jobs, options.output, options, "climbing in drawn worlds")
    falls, lost = sum(map(fell, rows)), sum(map(lost_grip, rows))
    at_goal = sum(row["verdict"] == CLIMBED for row in rows)
    ok = falls == 0 and lost == 0 and at_goal >= AT_GOAL_SHARE * options.count
    reasons = Counter(cause_of(row) for row in rows if row["verdict"] != CLIMBED)
    if options.json:
        found = {"climbed": at_goal, "fell": falls, "lost_grips": lost, "reasons": dict(reasons)}
        print_json({"ok": ok, "count": options.count, **found})
        return 0 if ok else 1
    note(f"at the goal without slip or fall {Rate(at_goal, options.count)}; {lost} lost a grip; {falls} fell")
    for reason, count in reasons.most_common():
        note(f"{count:5}  {reason}")
    note(f"results in {options.output}; crux report {options.output} -o FILE.html shows them")
    return 0 if ok else 1


def cause_of(row: Row) -> str:
    """Verdict and the first fault told, without its numbers."""
    reason = str(row["reason"]).split("; ")
    fault = next((part.split(": ")[1].split(",")[0] for part in reason if " s: " in part), "no fault told")
    mishap = ", fell" if fell(row) else ", lost a grip" if lost_grip(row) else ""
    return f"{row['verdict']}{mishap}: {fault if row['verdict'] == FAILED else reason[0]}"
