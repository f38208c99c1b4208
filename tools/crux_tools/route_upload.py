"""`crux upload FOLDER`: the parts of a route to a runtime, one after the other while the robot climbs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from crux_contracts.plan_file import PlanFileError, read_plan
from crux_contracts.plan_route import misfit, part_path
from crux_msgs import command_t, plan_t, robot_state_t

from crux_tools.errors import WorkFailed

AHEAD_S = 20.0  # of the plan's end: what follows is uploaded
LOOKS_EVERY_S = 0.5


def upload_route(
    link: Any, folder: Path, say: Callable[[str], None], sleep: Callable[[float], None] = time.sleep
) -> Any:
    """Uploads the first part and then, while the robot climbs, each that is there `AHEAD_S` before the end of what the
    runtime has. Ends where the robot stands at the end of the last part that is there.

    `link` is an OperatorLink. Returns the acknowledgement of the last upload. Raises PlanFileError, UsageError and
    WorkFailed.
    """
    if not (first := part_path(folder, 0)).exists():
        raise PlanFileError(f"{folder}: no {first.name} in it, expected a route of crux plan --stream")
    answer, end_s, before, number = None, 0.0, None, 0
    for state in _states(link, sleep):
        late = answer is not None and state.plan_complete != 0
        if answer is not None and not late and not _due(state, end_s):
            continue
        path = part_path(folder, number)
        if not path.exists():
            if late:
                return answer
            continue
        part = _next(path, before)
        answer = link.upload(part)
        begins = answer is not None and (late or before is None)
        end_s = part.knots[-1].time_s + (0.0 if begins else end_s)
        say(f"{path}: uploaded" + ("; crux start climbs it" if begins else ""))
        before, number = part, number + 1
    raise AssertionError("states go on for ever")


def _states(link: Any, sleep: Callable[[float], None]) -> Iterator[robot_state_t]:
    while True:
        link.command(command_t.STATUS)
        if link.status is None:
            raise WorkFailed("the runtime does not answer: is it running? The robot holds at the end of what it has")
        yield link.status.state
        sleep(LOOKS_EVERY_S)


def _due(state: robot_state_t, end_s: float) -> bool:
    climbs = state.supervisor_state == robot_state_t.CLIMBING and state.motion != robot_state_t.REVERSE
    return bool(climbs and state.plan_time_s > end_s - AHEAD_S)


def _next(path: Path, before: plan_t | None) -> plan_t:
    part = read_plan(path)
    if before is not None and (reason := misfit(before, part)):
        raise PlanFileError(f"{path}: does not go on from the part before: {reason}")
    return part
