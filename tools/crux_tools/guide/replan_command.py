"""`crux upload --replan`: stays beside a climb, and plans the moves ahead again where holds are not as on the map."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from crux_contracts.terminal import in_a_line
from crux_msgs import command_t, plan_t, status_t

from crux_tools.errors import WorkFailed
from crux_tools.guide.replanner import Replanner
from crux_tools.output import note
from crux_tools.plan_robot import robot_of_plan

LOOKS_EVERY_S = 0.1


def beside(link: Any, plan: plan_t, path: Path, sleep: Callable[[float], None] = time.sleep) -> Any:
    """Until the robot stands at the end of the plan. `link` is an OperatorLink, `path`
    the plan's file. Returns the last acknowledgement. Raises WorkFailed where the runtime does not answer: the robot
    climbs on as it was planned last.
    """
    replanner = Replanner(link, plan, robot_of_plan(plan, path), lambda line: note(f"replan: {in_a_line(line)}"))
    note("beside the climb; crux start begins it")
    while True:
        answer = link.command(command_t.STATUS)
        if answer is None or link.status is None:
            raise WorkFailed("the runtime does not answer: is it running? The robot climbs on as it was planned last")
        if link.status.state.plan_complete:
            return answer
        replanner.attend(lambda: _asked(link))
        sleep(LOOKS_EVERY_S)


def _asked(link: Any) -> status_t | None:
    link.command(command_t.STATUS)
    status: status_t | None = link.status
    return status
