"""Residuals of the ADMMs over their iterations, as the paper's Fig. 4 and Fig. 5 show them: a table and a picture."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_outputs
from crux_contracts.scenario import Scenario, load_scenario
from crux_planner.errors import InfeasibleError
from crux_planner.method_report import FORCE_THRESHOLD_N, POSITION_THRESHOLD_M
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS

from crux_simulation.benchmarks.setting import print_setting, setting, setting_text


@dataclass(frozen=True)
class Panel:
    """One picture of a figure: a residual, its unit, and the paper's threshold where it has one."""

    key: str
    unit: str
    title: str
    threshold: float | None = None


POSITION = Panel("position", "m", "body and finger positions", POSITION_THRESHOLD_M)
FORCE = Panel("force", "N", "finger forces", FORCE_THRESHOLD_N)
ORIENTATION = Panel("orientation", "rad", "body and finger rotation")
MOMENT = Panel("moment", "Nm", "finger moments")

ITERATIONS = {"two_block": 24, "multi_block": 64}

History = list[dict[str, float]]


@dataclass(frozen=True)
class ResidualFigure:
    """A figure of the paper as a bench: `residuals` of a scenario, a method, so many iterations."""

    name: str
    kind: str  # of scenario: walk or climb
    scene: str
    panels: tuple[Panel, ...]
    residuals: Callable[[Scenario, str, int], History]

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Options of the bench."""
        scene, picture = SCENARIOS / f"{self.scene}.yaml", Path(f"out/{self.name}.png")
        text = f"another {self.kind} (default: {self.scene})"
        parser.add_argument("--scenario", type=Path, default=scene, metavar="FILE", help=text)
        text = "picture (default: %(default)s)"
        parser.add_argument("--output", type=Path, default=picture, metavar="PNG", help=text)

    def run(self, options: argparse.Namespace) -> int:
        """Exit status 0 when both methods end within the paper's thresholds."""
        scenario = load_scenario(options.scenario)
        look_at_outputs({"--output": options.output}, (options.scenario,))
        said = setting()
        histories = {method: self._history(scenario, method, count) for method, count in ITERATIONS.items()}
        title = f"Residuals over the iterations: {scenario.name}\n{setting_text(said)}"
        draw(options.output, title, histories, self.panels)
        result = summary(histories, options.output) | {"setting": said}
        if options.json:
            print_json(result)
        else:
            print_table(histories, self.panels)
            print_setting(said)
            note(f"picture: {options.output}")
        return 0 if result["ok"] else 1

    def _history(self, scenario: Scenario, method: str, count: int) -> History:
        try:
            return self.residuals(scenario, method, count)
        except InfeasibleError as none:
            note(f"{method}: {none}")
            return []


def value(residuals: dict[str, float], panel: Panel, *, rms: bool) -> float:
    """One number of an iteration."""
    return residuals[f"{panel.key}_{'rms_' if rms else ''}{panel.unit}"]


def first_within(history: History) -> int | None:
    """The first iteration whose largest residuals are within both thresholds."""
    for i, residuals in enumerate(history, 1):
        if all(value(residuals, panel, rms=False) <= (panel.threshold or 0.0) for panel in (POSITION, FORCE)):
            return i
    return None


def print_table(histories: dict[str, History], panels: tuple[Panel, ...]) -> None:
    """Largest and root mean square of every residual, iteration by iteration."""
    for method, history in histories.items():
        note(f"{method}: largest / root mean square residual")
        note("  it " + " ".join(f"{panel.key + ' ' + panel.unit:>21}" for panel in panels))
        for i, residuals in enumerate(history, 1):
            cells = (f"{value(residuals, p, rms=False):>10.3g} {value(residuals, p, rms=True):>10.3g}" for p in panels)
            note(f"{i:>4} " + " ".join(cells))
        within = first_within(history)
        when = "never" if within is None else f"first in iteration {within}"
        note(f"  within {POSITION_THRESHOLD_M:g} m and {FORCE_THRESHOLD_N:g} N in the maximum norm: {when}")


def draw(path: Path, title: str, histories: dict[str, History], panels: tuple[Panel, ...]) -> None:
    """The picture: solid the largest residual, dashed the root mean square, dotted the threshold."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    rows = (len(panels) + 1) // 2
    figure, axes = plt.subplots(rows, 2, figsize=(9.0, 3.2 * rows), squeeze=False)
    for letter, panel, axis in zip("abcd", panels, axes.ravel(), strict=False):
        for (method, history), color in zip(histories.items(), ("tab:blue", "tab:orange"), strict=False):
            steps = range(1, len(history) + 1)
            for rms, style in ((False, "o-"), (True, "--")):
                values = [max(value(r, panel, rms=rms), 1e-9) for r in history]
                name = f"{method}, {'root mean square' if rms else 'largest'}"
                axis.semilogy(steps, values, style, color=color, markersize=3, label=name)
        if panel.threshold is not None:
            axis.axhline(panel.threshold, color="black", linestyle=":")
        axis.set(title=f"({letter}) {panel.title}", xlabel="iteration", ylabel=panel.unit)
    axes[0, 0].legend(fontsize=7)
    figure.suptitle(title, fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def summary(histories: dict[str, History], picture: Path) -> dict[str, Any]:
    """The bench's JSON object; ok where every method comes within the thresholds and ends there."""
    within = {method: first_within(history) for method, history in histories.items()}
    ends = all(first_within(history[-1:]) is not None for history in histories.values())
    return {"ok": ends, "first_within": within, "picture": str(picture), "history": histories}
