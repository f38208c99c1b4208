"""`crux bench fig7`: turned holds with slippery sides; which faces the planner grips, and where they look."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.plan_series import plan_series
from crux_contracts.scenario import FACE_NAMES
from crux_tools.output import note, print_json

from crux_simulation.benchmarks.cold_process import planned_scene

SCENE = "climb-slippery"
_TURN_DEG = (0.0, 180.0, 90.0, -90.0)  # of a face's outward normal against the hold's x, in the order of FACE_NAMES


@dataclass(frozen=True)
class Grip:
    """One grasp of a plan."""

    limb: str
    hold: str
    faces: str
    normal_deg: float
    """of finger 1's face, its outward normal in W: 0 up the wall, 90 to the left; the other face is opposite"""
    friction: float
    slippery: float
    """friction of the hold's other pair of faces"""
    gripper_yaw_deg: float
    first_s: float
    last_s: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fig7`."""
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-fig7"), metavar="DIR", help="for plan and picture"
    )


def grips_of(plan: Any) -> list[Grip]:
    """Every grasp of a plan_t, limb by limb in time."""
    series = plan_series(plan)
    face = np.array([[limb.finger1_face for limb in knot.limbs] for knot in plan.knots])
    grips = []
    for limb, name in enumerate(LIMB_NAMES):
        changes = np.flatnonzero(np.diff(series.hold[:, limb])) + 1
        for run in np.split(np.arange(len(series.time_s)), changes):
            index = int(series.hold[run[0], limb])
            if index < 0:
                continue
            hold, first = plan.holds[index], int(face[run[0], limb])
            pair = first // 2
            normal = float(np.degrees(hold.yaw_rad)) + _TURN_DEG[first]
            grips.append(
                Grip(
                    limb=name,
                    hold=hold.name,
                    faces=f"{FACE_NAMES[first]} {FACE_NAMES[first ^ 1]}",
                    normal_deg=(normal + 180.0) % 360.0 - 180.0,
                    friction=min(hold.friction[first], hold.friction[first ^ 1]),
                    slippery=min(hold.friction[2 - 2 * pair : 4 - 2 * pair]),
                    gripper_yaw_deg=float(np.degrees(series.gripper_yaw_rad[run[0], limb])),
                    first_s=float(series.time_s[run[0]]),
                    last_s=float(series.time_s[run[-1]]),
                )
            )
    return grips


def draw(plan: Any, grips: list[Grip], path: Path) -> None:
    """The wall from above with slippery faces in blue, and the gripped faces' normals."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.patches import Polygon

    figure, axes = plt.subplots(figsize=(7, 6))
    for hold in plan.holds:
        c, s = np.cos(hold.yaw_rad), np.sin(hold.yaw_rad)
        x, y = hold.size_m[0] / 2, hold.size_m[1] / 2
        corners = np.array([[x, y], [-x, y], [-x, -y], [x, -y]]) @ np.array([[c, s], [-s, c]])
        corners = corners + np.array(hold.position_w_m[:2])
        axes.add_patch(Polygon(corners[:, ::-1], facecolor="0.85", edgecolor="0.5"))
        for face, (a, b) in enumerate(((3, 0), (1, 2), (0, 1), (2, 3))):
            if hold.friction[face] == 0.0:
                axes.plot(corners[[a, b], 1], corners[[a, b], 0], color="tab:blue", linewidth=3)
    for grip in grips:
        hold = next(h for h in plan.holds if h.name == grip.hold)
        for side in (0.0, 180.0):
            angle = np.radians(grip.normal_deg + side)
            out = np.array([np.cos(angle), np.sin(angle)])
            end = np.array(hold.position_w_m[:2]) + out * (hold.size_m[0] / 2)
            axes.annotate("", end[::-1], (end + 0.05 * out)[::-1], arrowprops={"arrowstyle": "->", "color": "tab:red"})
        axes.text(hold.position_w_m[1], hold.position_w_m[0], grip.limb, ha="center", va="center", fontsize=8)
    axes.set_aspect("equal")
    axes.invert_xaxis()
    axes.autoscale_view()
    axes.set_xlabel("y [m], left")
    axes.set_ylabel("x [m], up the wall")
    axes.set_title("Fingers (red) and slippery faces (blue)")
    figure.savefig(path, dpi=150, bbox_inches="tight")
    plt.close(figure)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when no finger sits on a slippery face and the grippers had to turn for it."""
    plan, seconds = planned_scene(SCENE, options.output)
    picture = options.output / "fig7.png"
    grips = grips_of(plan)
    draw(plan, grips, picture)
    ok = all(grip.friction > 0.0 for grip in grips) and any(abs(grip.gripper_yaw_deg) > 20.0 for grip in grips)
    if options.json:
        print_json({"ok": ok, "seconds": seconds, "grips": [vars(grip) for grip in grips]})
        return 0 if ok else 1
    note(
        f"{'limb':<5} {'hold':<17} {'faces':<6} {'normal deg':>10} {'friction':>9} {'other pair':>11} {'from':>7} to s"
    )
    for grip in grips:
        note(
            f"{grip.limb:<5} {grip.hold:<17} {grip.faces:<6} {grip.normal_deg:>10.0f} {grip.friction:>9.1f} "
            f"{grip.slippery:>11.1f} {grip.first_s:>7.0f} {grip.last_s:.0f}"
        )
    note(f"planned in {seconds:.2f} s; {picture}; 0 degrees is up the wall, 90 to the left")
    return 0 if ok else 1
