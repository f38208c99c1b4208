"""The parts of a route to a runtime: when each is sent, and where that ends."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from crux_contracts.plan_file import PlanFileError, write_plan
from crux_contracts.plan_route import part_path
from crux_msgs import command_t, plan_t, robot_state_t
from crux_tools.errors import WorkFailed
from crux_tools.route_upload import AHEAD_S, upload_route
from hand_plan import standing_plan

PART_S = 40.0


class Robot:
    """A runtime whose clock runs while it climbs; it begins once it has a plan."""

    def __init__(self) -> None:
        self.time_s, self.end_s, self.answers = 0.0, 0.0, True
        self.taken: list[tuple[float, float]] = []  # where its clock stood, and what was left of its plan
        self.status: SimpleNamespace | None = None
        self.state = robot_state_t.READY

    def command(self, command: int) -> None:
        assert command == command_t.STATUS
        complete = self.end_s > 0.0 and self.time_s >= self.end_s
        self.state = robot_state_t.HOLDING if complete else robot_state_t.CLIMBING if self.end_s else self.state
        state = SimpleNamespace(
            supervisor_state=self.state,
            motion=robot_state_t.FORWARD,
            plan_time_s=self.time_s,
            plan_complete=int(complete),
        )
        self.status = SimpleNamespace(state=state) if self.answers else None

    def upload(self, plan: plan_t) -> str:
        self.taken.append((self.time_s, self.end_s - self.time_s))
        if self.state == robot_state_t.HOLDING:  # as a plan of its own, from its beginning
            self.time_s, self.end_s = 0.0, 0.0
        self.end_s += plan.knots[-1].time_s
        return f"answer {len(self.taken)}"

    def sleep(self, time_s: float) -> None:
        self.time_s = min(self.time_s + time_s, self.end_s)


@pytest.fixture
def part() -> plan_t:
    plan = standing_plan()
    plan.dt_s = PART_S
    plan.knots[1].time_s = PART_S
    return plan


def test_each_part_is_sent_before_the_one_before_ends(part: plan_t, tmp_path: Path) -> None:
    for number in range(4):
        write_plan(part_path(tmp_path, number), part)
    robot, said = Robot(), list[str]()
    assert upload_route(robot, tmp_path, said.append, robot.sleep) == "answer 4"
    assert robot.end_s == 4 * PART_S
    assert robot.time_s == robot.end_s
    assert all(0.9 * AHEAD_S < left <= AHEAD_S for _, left in robot.taken[1:])
    assert [line.endswith("; crux start climbs it") for line in said] == [True, False, False, False]


def test_a_part_that_comes_late_is_climbed_from_where_the_robot_holds(part: plan_t, tmp_path: Path) -> None:
    write_plan(part_path(tmp_path, 0), part)
    robot, said = Robot(), list[str]()

    def sleep(time_s: float) -> None:
        robot.sleep(time_s)
        if robot.time_s >= PART_S and len(robot.taken) == 1:
            write_plan(part_path(tmp_path, 1), part)

    assert upload_route(robot, tmp_path, said.append, sleep) == "answer 2"
    assert robot.taken[1] == (PART_S, 0.0)
    assert said[1].endswith("; crux start climbs it")


def test_parts_that_do_not_fit_are_not_sent(part: plan_t, tmp_path: Path) -> None:
    write_plan(part_path(tmp_path, 0), part)
    part.knots[0].body_position_w_m = [0.001, *part.knots[0].body_position_w_m[1:]]
    write_plan(part_path(tmp_path, 1), part)
    robot = Robot()
    with pytest.raises(PlanFileError, match=r"00001\.mcap: does not go on from the part before: the body"):
        upload_route(robot, tmp_path, lambda _line: None, robot.sleep)
    assert len(robot.taken) == 1


def test_an_empty_folder_and_a_runtime_that_is_gone_are_told(part: plan_t, tmp_path: Path) -> None:
    robot = Robot()
    with pytest.raises(PlanFileError, match=r"no 00000\.mcap in it"):
        upload_route(robot, tmp_path, lambda _line: None, robot.sleep)
    write_plan(part_path(tmp_path, 0), part)
    robot.answers = False
    with pytest.raises(WorkFailed, match="does not answer"):
        upload_route(robot, tmp_path, lambda _line: None, robot.sleep)
