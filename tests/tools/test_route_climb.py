"""A route in parts, climbed while the parts come: one climb without a stop, as if its plan had been whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from climbs import climb_here
from crux_contracts.plan_file import plan_id, write_plan
from crux_contracts.plan_route import joined, misfit, part_path
from crux_msgs import limb_knot_t, plan_t, robot_state_t
from crux_tools.replay import recompute
from crux_tools.telemetry.reader import Telemetry, read_log
from hand_plan import climbing_plan


def cut(whole: plan_t, first: int, last: int) -> plan_t:
    """The knots from one stance of a plan to another, as a plan of its own."""
    part = plan_t.decode(whole.encode())
    part.knots = part.knots[first : last + 1]
    begin_s = part.knots[0].time_s
    for knot in part.knots:
        knot.time_s -= begin_s
    part.n_knots = len(part.knots)
    part.plan_id = plan_id(part)
    return part


@pytest.fixture(scope="module")
def parts() -> list[plan_t]:
    """Two limbs go to their next holds, one in each part."""
    whole = climbing_plan(limbs_to_move=(0, 1))
    held = [all(limb.phase == limb_knot_t.STANCE for limb in knot.limbs) for knot in whole.knots]
    landed = next(k for k in range(1, len(held)) if held[k] and not held[k - 1])
    return [cut(whole, 0, landed + 1), cut(whole, landed + 1, len(whole.knots) - 1)]


@pytest.fixture(scope="module")
def climbed(parts: list[plan_t], tmp_path_factory: pytest.TempPathFactory) -> tuple[int, Telemetry]:
    folder = tmp_path_factory.mktemp("route")
    for number, part in enumerate(parts):
        write_plan(part_path(folder, number), part)
    status, result = climb_here(folder, folder / "log.mcap")
    assert result["ok"] is (status == 0)
    return status, read_log(folder / "log.mcap")


def test_the_parts_make_the_whole_plan(parts: list[plan_t]) -> None:
    whole, made = climbing_plan(limbs_to_move=(0, 1)), joined(*parts)
    assert misfit(*parts) == ""
    assert [knot.encode() for knot in made.knots] == [knot.encode() for knot in whole.knots]
    assert [hold.name for hold in made.holds] == [hold.name for hold in whole.holds]


def test_the_robot_climbs_both_without_a_stop(parts: list[plan_t], climbed: tuple[int, Telemetry]) -> None:
    status, log = climbed
    assert status == 0
    states = log.state["supervisor_state"]
    climbing = np.flatnonzero(states == robot_state_t.CLIMBING)
    assert (states[climbing[0] : climbing[-1] + 1] == robot_state_t.CLIMBING).all()
    assert log.state["plan_time_s"][-1] == pytest.approx(joined(*parts).knots[-1].time_s)


def test_the_log_has_the_plan_as_the_runtime_joined_it(parts: list[plan_t], climbed: tuple[int, Telemetry]) -> None:
    assert climbed[1].plan is not None
    assert climbed[1].plan.plan_id == joined(*parts).plan_id


def test_its_log_is_computed_again_to_the_bit(climbed: tuple[int, Telemetry]) -> None:
    found = recompute.recompute(climbed[1].path)
    assert found.first_difference is None
    assert found.cycles > 1000


@pytest.mark.parametrize("options", [("--bus", "udp"), ("--guide",)])
def test_a_route_needs_the_runtime_in_this_process(
    options: tuple[str, ...], parts: list[plan_t], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, part in enumerate(parts):
        write_plan(part_path(tmp_path, number), part)
    assert climb_here(tmp_path, tmp_path / "log.mcap", *options)[0] == 2
    assert "a route in parts is climbed with --bus memory and without --guide" in capsys.readouterr().err
