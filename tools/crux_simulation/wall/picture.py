"""A picture of an imported wall: heights, holds in green, and what is none in red with the number of its reason."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from crux_simulation.wall.box import Box
from crux_simulation.wall.imported import Imported

SHOWN = 60_000  # samples


def picture(found: Imported) -> bytes:
    """PNG; x of the wall goes up, y to the left, as the robot sees it."""
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    axes = figure.add_subplot()
    if found.wall is not None:
        points = found.wall.surface.samples.points
        points = points[:: max(1, len(points) // SHOWN)]
        shade = axes.scatter(points[:, 1], points[:, 0], c=1000.0 * points[:, 2], s=1.0, cmap="Greys", vmin=-20.0)
        figure.colorbar(shade, label="mm off the wall", shrink=0.6)
    reasons = list(found.reasons)
    for box in found.boxes:
        colour = "tab:green" if box.is_hold else "tab:red"
        corners = _corners(box)
        axes.add_patch(Polygon(corners[:, ::-1], closed=True, fill=False, edgecolor=colour, linewidth=1.5))
        label = box.name.removeprefix("hold-") if box.is_hold else ""
        if box.reason in reasons:
            label = f"({reasons.index(box.reason) + 1})"
        axes.annotate(label, (box.foot_m[1], box.foot_m[0]), color=colour, ha="center", va="center", fontsize=8)
    stances = [end for end in (found.ends.start, found.ends.goal) if end is not None]
    for stance, name in zip(stances, ("start", "goal"), strict=False):
        axes.plot(stance.body_m[1], stance.body_m[0], "b+", markersize=14)
        axes.annotate(f" {name}", (stance.body_m[1], stance.body_m[0]), color="b")
    axes.autoscale_view()
    axes.invert_xaxis()
    axes.set(aspect="equal", xlabel="y [m]", ylabel="x up the wall [m]", title=f"{len(found.holds)} holds (green)")
    text = "\n".join(f"({i}) {reason}: {count}" for i, (reason, count) in enumerate(found.reasons.items(), 1))
    figure.supxlabel(text, ha="left", x=0.02, fontsize=8)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110)
    return out.getvalue()


def _corners(box: Box) -> np.ndarray:
    """(4, 2) of its foot in x and y of W."""
    unit = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]]) / 2.0
    return np.asarray((box.foot_m + unit * box.size_m @ box.rotation.T)[:, :2])
