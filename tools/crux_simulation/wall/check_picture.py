"""A picture of what `crux wall check` found: each hold with a dot for every limb that gets there from the start."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import Cuboid, Scenario
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

if TYPE_CHECKING:
    from crux_planner.method_report import WallReport

COLOURS = dict(zip(LIMB_NAMES, ("tab:blue", "tab:orange", "tab:purple", "tab:olive"), strict=True))
DOTS = dict(zip(LIMB_NAMES, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True))  # quarter of a hold, x up and y left


def picture(scenario: Scenario, report: WallReport) -> bytes:
    """PNG; x of the wall goes up, y to the left, as the robot sees it."""
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    axes = figure.add_subplot()
    for cuboid in scenario.cuboids:
        axes.add_patch(Polygon(_corners(cuboid), closed=True, color="lightgrey"))
    reasons: list[str] = []
    for hold in scenario.holds:
        pairs = [pair for pair in report.pairs if pair.hold == hold.name]
        good = any(not pair.reason for pair in pairs)
        colour = "tab:green" if good else "tab:red"
        axes.add_patch(Polygon(_corners(hold), closed=True, fill=False, edgecolor=colour, linewidth=1.5))
        x, y = hold.position_m
        label = hold.name
        if not good:
            reasons.append("; ".join(f"{pair.faces}: {pair.reason}" for pair in pairs))
            label = f"({len(reasons)})"
        axes.annotate(label, (y, x + hold.size_m[0] / 2 + 0.01), color=colour, ha="center", fontsize=7)
        for limb in sorted({limb for pair in pairs for limb in report.held_by.get((hold.name, pair.faces), [])}):
            up, left = (side * size / 4 for side, size in zip(DOTS[limb], hold.size_m, strict=False))
            axes.plot(y + left, x + up, "o", color=COLOURS[limb], markersize=5)
    for limb, colour in COLOURS.items():
        axes.plot([], [], "o", color=colour, label=f"{limb} gets there from the start")
    if report.begun is not None:
        axes.plot(report.begun.body_m[1], report.begun.body_m[0], "k+", markersize=14, label="body at the start")
    if report.top is not None:
        axes.plot(report.top.body_h_m[1], report.top.body_h_m[0], "k^", markersize=10, label="highest body")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=3, fontsize=8)
    axes.autoscale_view()
    axes.invert_xaxis()
    gripped = sum(not pair.reason for pair in report.pairs)
    title = f"{gripped} of {len(report.pairs)} pairs of faces can be gripped (green)"
    axes.set(aspect="equal", xlabel="y [m]", ylabel="x up the wall [m]", title=title)
    figure.supxlabel("\n".join(f"({i}) {text}" for i, text in enumerate(reasons, 1)), ha="left", x=0.02, fontsize=7)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110)
    return out.getvalue()


def _corners(cuboid: Cuboid) -> np.ndarray:
    """(4, 2) as y, x."""
    c, s = np.cos(cuboid.yaw_rad), np.sin(cuboid.yaw_rad)
    unit = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) / 2.0
    corners = np.asarray(cuboid.position_m) + unit * cuboid.size_m[:2] @ np.array([[c, s], [-s, c]])
    return np.asarray(corners[:, ::-1])
