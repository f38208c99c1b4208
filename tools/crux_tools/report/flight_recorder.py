"""The second before a fault as one plot: joints, grips, wrenches, which nodes were heard, and how late cycles were."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES, can_codec
from matplotlib.axes import Axes

from crux_tools.report import figures
from crux_tools.report.evidence import Moment, fresh_nodes, part_of
from crux_tools.telemetry.summary import is_realtime, wrench_error

AFTER_S = 0.3
LIMB_COLOURS = ("#2465b0", "#d9822b", "#2a9d58", "#b5305f")
LEGEND: dict[str, Any] = {"fontsize": 7, "frameon": False, "loc": "center left", "bbox_to_anchor": (1.0, 0.5)}
NS_PER_MS = 1e6
_HEARD, _SILENT = "#cfe3d4", "#e0566a"


def flight_recorder(at: Moment) -> bytes:
    """PNG. Of the joints those of the fault's limb, of a fault of no limb the joint furthest off of each."""
    log = at.log
    end = int(np.searchsorted(log.time_s, at.fault.time_s + AFTER_S, "right"))
    rows = slice(at.first, end)
    time_s = log.time_s[rows] - at.fault.time_s
    figure, axes = figures.rows_of(5, 8.4)
    limb = LIMB_NAMES.index(at.fault.limb) if at.fault.limb in LIMB_NAMES else None
    _joints(axes[0], time_s, at, rows, limb)
    finger, wanted = log.inputs["finger_force_n"][rows], log.limbs["grasp_force_reference_n"][rows]
    force = wrench_error(log)[0][rows]
    for i, name in enumerate(LIMB_NAMES):
        style: dict[str, Any] = {"color": LIMB_COLOURS[i], "linewidth": 1.8 if i == limb else 0.9}
        axes[1].plot(time_s, finger[:, i], label=name, **style)
        axes[1].plot(time_s, wanted[:, i], linestyle="--", color=LIMB_COLOURS[i], linewidth=0.8)
        axes[2].plot(time_s, force[:, i], **style)
    axes[1].set_ylabel("finger force [N]\n(dashed: wanted)")
    axes[1].legend(**LEGEND)
    axes[2].set_ylabel("force off\nthe plan [N]")
    _nodes(axes[3], time_s, fresh_nodes(log, rows), limb)
    _lateness(axes[4], at, rows)
    for axis in axes:
        axis.axvline(0, color="#c0392b", linewidth=1.2)
        axis.yaxis.label.set_fontsize(8)
    axes[-1].set_xlabel(f"time from the fault at {at.fault.time_s:.3f} s [s]")
    axes[-1].set_xlim(time_s[0], time_s[-1])
    return figures.png(figure)


def _joints(axis: Axes, time_s: np.ndarray, at: Moment, rows: slice, limb: int | None) -> None:
    """How far joints are off their commands; of the node that the fault names, position and command themselves."""
    shape = (len(time_s), len(LIMB_NAMES), -1)
    measured = at.log.inputs["joint_position_rad"][rows].reshape(shape)
    command = at.log.outputs["joint_position_rad"][rows].reshape(shape)
    if limb is not None and at.fault.node in can_codec.JOINT_NODES:
        joint = can_codec.JOINT_NODES.index(at.fault.node)
        begin = command[0, limb, joint]
        axis.plot(time_s, 1e3 * (measured[:, limb, joint] - begin), color=LIMB_COLOURS[limb], label="measured")
        axis.plot(time_s, 1e3 * (command[:, limb, joint] - begin), "--", color="#333333", label="commanded")
        axis.set_ylabel(f"{at.fault.limb} joint {joint + 1}\nfrom its begin [mrad]")
    else:
        off = 1e3 * (measured - command)
        for i, name in enumerate(LIMB_NAMES) if limb is None else ():
            furthest = int(np.abs(off[:, i]).max(axis=0).argmax())
            axis.plot(time_s, off[:, i, furthest], color=LIMB_COLOURS[i], label=f"{name} joint {furthest + 1}")
        for joint in range(off.shape[2]) if limb is not None else ():
            axis.plot(time_s, off[:, limb, joint], linewidth=1.0, label=f"joint {joint + 1}")
        axis.set_ylabel(f"{at.fault.limb or 'joints'} off\ncommand [mrad]")
    axis.legend(**LEGEND)


def _nodes(axis: Axes, time_s: np.ndarray, fresh: np.ndarray, limb: int | None) -> None:
    """A lane a node of the fault's limb, else a lane a limb: red where a status did not come."""
    heard = np.asarray(fresh.all(axis=2) if limb is None else fresh[:, limb])
    names = (
        LIMB_NAMES
        if limb is None
        else [f"{LIMB_NAMES[limb]} {part_of(n, fresh.shape[2])}" for n in range(fresh.shape[2])]
    )
    step = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0
    for lane in range(len(names)):
        axis.broken_barh([(time_s[0], time_s[-1] - time_s[0])], (lane - 0.4, 0.8), facecolors=_HEARD)
        missed = [(float(time_s[row]), step) for row in np.flatnonzero(~heard[:, lane])]
        axis.broken_barh(missed, (lane - 0.4, 0.8), facecolors=_SILENT)
    axis.set_yticks(range(len(names)), names, fontsize=7)
    axis.invert_yaxis()
    axis.grid(visible=False, axis="y")
    axis.set_ylabel("answers\n(red: none)")


def _lateness(axis: Axes, at: Moment, rows: slice) -> None:
    """Of every cycle; in lockstep there is no clock to be late by, only the computing time."""
    timing, cycles = at.log.timing, at.log.inputs["cycle"][rows]
    step_s = float(at.log.inputs["dt_s"][0])
    if len(timing) and len(cycles):
        mine = timing[(timing["cycle"] >= cycles[0]) & (timing["cycle"] <= cycles[-1])]
        time_s = mine["cycle"] * step_s - at.fault.time_s
        axis.plot(time_s, mine["compute_ns"] / NS_PER_MS, color="#777777", linewidth=0.9, label="computing")
        if is_realtime(at.log):
            axis.plot(time_s, mine["late_ns"] / NS_PER_MS, color="#b5305f", linewidth=1.2, label="late")
        axis.legend(**LEGEND)
    axis.set_ylabel("cycle [ms]")
