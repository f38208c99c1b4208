"""`crux bench fig8`: shear of a finger that never presses, over time: micro-spines alone carry it."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.plan_series import plan_series
from crux_contracts.scenario import parse_scenario
from crux_tools.output import note, print_json
from numpy.typing import NDArray

from crux_simulation.benchmarks.cold_process import planned_scene

SCENE = "climb-spines-only"
PRESSED_N = 1e-3  # a finger that presses no harder than this does not press
CARRIED = 0.1  # of the spines' limit: less is no shear to speak of

Floats = NDArray[np.float64]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fig8`."""
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-fig8"), metavar="DIR", help="for plan and picture"
    )


def finger_history(plan: Any, limb: int, finger: int) -> tuple[Floats, Floats, Floats]:
    """Time (K,), normal force (K,) and shear (K, 2) along the wall and off it, NaN in the air, of a finger (1 or 2)."""
    series = plan_series(plan)
    axis = series.opening_axis[:, limb] * (1.0 if finger == 1 else -1.0)
    across = np.stack([-series.opening_axis[:, limb, 1], series.opening_axis[:, limb, 0]], axis=1)
    force = np.where(series.stance[:, limb, None], series.finger_force_n[:, limb, finger - 1], np.nan)
    shear = np.stack([(force[:, :2] * across).sum(axis=1), force[:, 2]], axis=1)
    return series.time_s, np.asarray((force * axis).sum(axis=1)), shear


def draw(histories: dict[str, tuple[Floats, Floats, Floats]], limit_N: float, path: Path) -> None:
    """Shear and normal force over time, a row for each finger."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, rows = plt.subplots(len(histories), 1, figsize=(8, 3.2 * len(histories)), squeeze=False)
    for axes, (name, (time_s, normal, shear)) in zip(rows[:, 0], histories.items(), strict=True):
        axes.step(time_s, shear[:, 0], where="post", label="shear along the wall")
        axes.step(time_s, shear[:, 1], where="post", label="shear off the wall")
        axes.step(time_s, normal, where="post", color="black", label="normal force")
        for side in (-limit_N, limit_N):
            axes.axhline(side, color="0.6", linestyle="--")
        axes.set(title=name, xlabel="time [s]", ylabel="force [N]")
        axes.legend(loc="upper right", fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=150)
    plt.close(figure)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the finger never presses, carries shear, and stays within what its spines hold."""
    plan, seconds = planned_scene(SCENE, options.output)
    picture = options.output / "fig8.png"
    contact = parse_scenario(plan.scenario_yaml).contact
    limit_N = contact.spine_shear_N
    histories = {
        f"{limb} finger {finger}": finger_history(plan, LIMB_NAMES.index(limb), finger)
        for limb, finger in contact.spines_only.items()
    }
    draw(histories, limit_N, picture)
    largest = {
        name: (float(np.nanmax(np.abs(normal))), float(np.nanmax(np.abs(shear))))
        for name, (_, normal, shear) in histories.items()
    }
    ok = all(normal <= PRESSED_N and CARRIED * limit_N < shear <= limit_N for normal, shear in largest.values())
    if options.json:
        fingers = {name: {"normal_N": normal, "shear_N": shear} for name, (normal, shear) in largest.items()}
        print_json({"ok": ok, "seconds": seconds, "limit_N": limit_N, "largest": fingers})
        return 0 if ok else 1
    for name, (time_s, normal, shear) in histories.items():
        note(f"{name}\n{'time s':>7} {'normal N':>9} {'along N':>8} {'off N':>7}   (spines: {limit_N:g} N)")
        for t, n, (along, off) in zip(time_s[::2], normal[::2], shear[::2], strict=True):
            in_air = np.isnan(n)
            note(f"{t:>7.0f}      in the air" if in_air else f"{t:>7.0f} {abs(n):>9.2f} {along:>8.2f} {off:>7.2f}")
    note(f"planned in {seconds:.2f} s; {picture}")
    return 0 if ok else 1
