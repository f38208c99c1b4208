"""One large picture of the robot in the middle of a swing, as the README shows it."""

from __future__ import annotations

import io
from typing import Any

from crux_contracts.plan_series import plan_series

from crux_tools.errors import WorkFailed
from crux_tools.report.pictures import open_stage
from crux_tools.report.renderer import NoGraphicsError
from crux_tools.robot3d.start_pose import RobotPose
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.summary import SWING, runs

SIZE_PX = (1000, 700)


def _middle_row(log: Telemetry) -> int:
    """The middle of the middle swing, or the end of a log without one."""
    swinging = (log.references["phase"] == SWING).any(axis=1)
    swings = [(first, end) for first, end in runs(swinging) if swinging[first]]
    if not swings:
        return len(log.time_s) - 1
    first, end = swings[len(swings) // 2]
    return (first + end) // 2


def showpiece(plan: Any, log: Telemetry | None) -> bytes:
    """PNG of the middle swing of a climb, or of a plan. Raises WorkFailed where nothing can be rendered or shown."""
    if plan is None:
        raise WorkFailed("no picture: no plan was accepted in this log, so there is no wall to show")
    try:
        with open_stage(plan, SIZE_PX, log.robot_files if log is not None else {}) as stage:
            if log is not None:
                stage.show_cycle(log, _middle_row(log))
            else:
                swings = plan_series(plan).swings()
                middle = swings[len(swings) // 2] if swings else None
                knot = (middle.first + middle.last + 1) // 2 if middle else 0
                stage.show_pose(RobotPose.of_knot(plan.knots[knot], stage.robot))
            image = stage.image()
    except NoGraphicsError as error:
        raise WorkFailed(f"no picture: {error}") from error
    buffer = io.BytesIO()
    image.save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
