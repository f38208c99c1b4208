"""`crux bench fig6`: the gait of two-block ADMM's MIP without and with moments, the paper's Fig. 6.

A steep wall on which the holds of diagonal limbs stand side by side, and a cost that is impatient to be at the goal:
the MIP, which knows of forces alone (8a), begins with diagonal limbs that go together, and the checker sees the robot
tumble. With moments (8b) in the same MIP one limb goes at a time. In the paper the MIP learns of moments from the NLP,
within 6 iterations; what its gait is here after so many as the method has is shown beside, and counts for nothing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.output_file import look_at_outputs
from crux_contracts.scenario import Scenario, parse_scenario
from crux_tools.output import note, print_json

from crux_simulation.benchmarks.random_walls import BODY_HEIGHT_M, CONTACT
from crux_simulation.benchmarks.setting import print_setting, setting, setting_text

SLOPE_DEG = 75.0
ROWS_M, STAGGER_M, ASIDE_M = 0.16, 0.03, 0.36  # of the start's holds
ADVANCE_M, BODY_ADVANCE_M = 0.14, 0.25
HOLD_M = 0.06
BODY_WEIGHT = 50.0  # of the body's distance from the goal, where 1 is usual
ITERATIONS = 10
TUMBLING = "moment_balance"
_HELD, _AWAY = "─", "█"


@dataclass(frozen=True)
class Gait:
    """Which limbs are away when, and what the checker says."""

    name: str
    order: list[str]
    away: list[list[bool]]  # (4, N + 1)
    ok: bool
    tumbling_Nm: float  # by which moments are off balance
    cost: float

    @property
    def most_away(self) -> int:
        """Limbs away together."""
        return max(map(sum, zip(*self.away, strict=True)))

    def as_json(self) -> dict[str, Any]:
        """One entry of the bench's JSON object."""
        return {
            "gait": self.order,
            "most_limbs_away": self.most_away,
            "check_ok": self.ok,
            "moment_imbalance_Nm": self.tumbling_Nm,
            "cost": self.cost,
        }


def trot_wall() -> str:
    """The scenario as YAML text."""
    holds: list[dict[str, Any]] = []
    for row, advance in (("low", 0.0), ("high", ADVANCE_M)):
        for name in LIMB_NAMES:
            front, left = 1 if name[1] == "F" else -1, 1 if name[0] == "L" else -1
            # Left in front and right behind stand back, the other two forward: diagonal limbs want the same.
            along = front * ROWS_M - front * left * STAGGER_M + advance
            place = [round(along, 4), left * ASIDE_M]
            holds.append({"name": f"{name}-{row}", "position_m": place, "size_m": [HOLD_M] * 3, "friction": 2.2})
    grasps = {row: {name: {"hold": f"{name}-{row}", "faces": "x"} for name in LIMB_NAMES} for row in ("low", "high")}
    scenario = {
        "version": 1,
        "name": "trot-wall",
        "robot": "scaler",
        "wall": {"slope_deg": SLOPE_DEG},
        "contact": CONTACT,
        "holds": holds,
        "start": {"body": {"position_m": [0.0, 0.0, BODY_HEIGHT_M]}, "grasps": grasps["low"]},
        "goal": {"body": {"position_m": [BODY_ADVANCE_M, 0.0, BODY_HEIGHT_M]}, "grasps": grasps["high"]},
        "horizon": {"steps": 40, "dt_s": 2.0},
        "planner": {"idle": "keep", "weights": {"body": BODY_WEIGHT}},
    }
    return yaml.safe_dump(scenario, sort_keys=False)


def gait_decided(scenario: Scenario, iterations: int = 1, *, moments: bool = False) -> Gait:
    """The gait of two-block ADMM's MIP after some iterations, (8b) in it or left to the NLP."""
    from crux_planner.method_report import climb_report

    reached = climb_report(scenario, "two_block", iterations=iterations, moments=moments)
    off = [v.amount for v in reached.check.violations if v.constraint == TUMBLING]
    schedule = reached.decided.knots.schedule
    away = [[knot[limb] is None for knot in schedule.contacts] for limb in range(len(LIMB_NAMES))]
    name = f"after {reached.decided.iterations} iteration(s), moments {'in' if moments else 'not in'} the MIP"
    return Gait(name, schedule.gait, away, reached.check.ok, max(off, default=0.0), reached.decided.knots.cost)


def lines(gait: Gait) -> Iterable[str]:
    """The gait diagram as text."""
    verdict = "passes the check" if gait.ok else f"rejected: moments {gait.tumbling_Nm:.3g} Nm off balance"
    yield f"{gait.name}: {' '.join(gait.order)}; {verdict}"
    for limb, away in zip(LIMB_NAMES, gait.away, strict=True):
        yield f"  {limb} " + "".join(_AWAY if gone else _HELD for gone in away)


def draw(path: Path, gaits: list[Gait], dt_s: float, title: str = "") -> None:
    """The gait diagrams as a picture."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(len(gaits), 1, figsize=(8.0, 1.9 * len(gaits)), squeeze=False)
    for gait, axis in zip(gaits, axes.ravel(), strict=True):
        for limb, away in enumerate(gait.away):
            spans = [(dt_s * k, dt_s) for k, gone in enumerate(away) if gone]
            axis.broken_barh(spans, (limb - 0.4, 0.8), color="tab:green" if gait.ok else "tab:red")
        axis.set_yticks(range(len(LIMB_NAMES)), LIMB_NAMES)
        axis.set_xlim(0.0, dt_s * len(gait.away[0]))
        axis.invert_yaxis()
        axis.set_title(next(iter(lines(gait))), fontsize=9)
    axes[-1, 0].set_xlabel("t [s]; bars: limb in the air")
    figure.suptitle(title, fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fig6`."""
    parser.add_argument(
        "--output", type=Path, default=Path("out/fig6.png"), metavar="PNG", help="picture (default: %(default)s)"
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the MIP trots without moments, and tumbles, and with them moves one limb at a time."""
    look_at_outputs({"--output": options.output})
    scenario, said = parse_scenario(trot_wall(), "trot-wall"), setting()
    trot, single = gait_decided(scenario), gait_decided(scenario, moments=True)
    gaits = [trot, single, gait_decided(scenario, ITERATIONS)]
    ok = trot.most_away == 2 and trot.tumbling_Nm > 0.0 and single.most_away == 1
    draw(options.output, gaits, scenario.horizon.dt_s, setting_text(said))
    if options.json:
        print_json({"ok": ok, "gaits": {gait.name: gait.as_json() for gait in gaits}, "setting": said})
    else:
        for gait in gaits:
            for line in lines(gait):
                note(line)
        print_setting(said)
        note(f"picture: {options.output}")
    return 0 if ok else 1
