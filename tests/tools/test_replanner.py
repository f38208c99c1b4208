"""Planning again on the way: on holds that are off the map, in physics; and what of it is kept, logged and told."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from climbs import climb_here
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_msgs import plan_t, robot_state_t
from crux_planner import stances
from crux_tools.errors import WorkFailed
from crux_tools.guide import replanner
from crux_tools.guide.measured import Found, found_holds, scenario_with
from crux_tools.guide.replan_command import beside
from crux_tools.guide.replanner import Replanner
from crux_tools.replay.recompute import recompute
from crux_tools.report.replans import replan_sections
from crux_tools.telemetry.reader import Telemetry, read_log
from shared_plans import SharedPlans

SCENES = Path(__file__).parents[2] / "msgs" / "scenarios"
WORLD = (
    "version: 1\nname: test\nholds: {0: {offset_m: [0.011, -0.008, 0]}, 2: {offset_m: [-0.009, 0.01, 0], yaw_deg: 4}}\n"
)


@pytest.fixture(scope="module")
def plan(planned: SharedPlans) -> plan_t:
    """The wall of four holds a side: four moves."""
    made: plan_t = planned(load_scenario(SCENES / "climb-four-holds.yaml"), load_robot("scaler")).plan
    return made


@pytest.fixture(scope="module")
def climbed(plan: plan_t, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Telemetry]:
    folder = tmp_path_factory.mktemp("replan")
    write_plan(folder / "plan.mcap", plan)
    (folder / "world.yaml").write_text(WORLD)
    given = ("--world", str(folder / "world.yaml"), "--replan")
    _, result = climb_here(folder / "plan.mcap", folder / "log.mcap", *given)
    return result, read_log(folder / "log.mcap")


def test_the_robot_climbs_on_by_what_was_planned_on_the_way(
    plan: plan_t, climbed: tuple[dict[str, Any], Telemetry]
) -> None:
    result, log = climbed
    made = result["replans"]["each"]
    assert result["reached_goal"], result["reason"]
    assert not result["fell"]
    assert any(each["kept"] for each in made), made
    kept = [loaded for _, loaded in log.plans[1:]]
    assert len(kept) == sum(each["kept"] for each in made)
    assert [loaded.method for loaded in kept] == [f"replanned: {each['why']}" for each in made if each["kept"]]
    off = kept[-1].holds[0].position_w_m - np.array(plan.holds[0].position_w_m)
    assert np.linalg.norm(off) > 0.005
    states = log.state["supervisor_state"]
    climbing = np.flatnonzero(states == robot_state_t.CLIMBING)
    assert (states[climbing[0] : climbing[-1] + 1] == robot_state_t.CLIMBING).all()  # without a stop


def test_the_body_jumps_nowhere(climbed: tuple[dict[str, Any], Telemetry]) -> None:
    reference = climbed[1].state["body_reference_position_w_m"]
    assert np.abs(np.diff(reference, axis=0)).max() < 4e-4  # 2 ms of 0.2 m/s


def test_its_log_is_computed_again_to_the_bit(climbed: tuple[dict[str, Any], Telemetry]) -> None:
    found = recompute(climbed[1].path)
    assert found.first_difference is None


def test_the_report_tells_of_each_one_made(climbed: tuple[dict[str, Any], Telemetry]) -> None:
    result, log = climbed
    (section,) = replan_sections(log)
    assert len(section.rows) == result["replans"]["made"]
    assert all(each["why"] in row[1] for each, row in zip(result["replans"]["each"], section.rows, strict=True))
    log.metadata.pop("replans")  # as of a robot
    (section,) = replan_sections(log)
    assert len(section.rows) == result["replans"]["kept"]


def status_of(plan: plan_t, knot: int, shift_m: tuple[float, float] = (0.0, 0.0), slipped: float = 0.0) -> Any:
    """A robot that stands in a stance, all grips as planned but that of RF."""
    limbs = []
    for number, grip in enumerate(plan.knots[knot].limbs):
        x, y, z = grip.gripper_position_w_m
        off = shift_m if number == 1 else (0.0, 0.0)
        half = grip.gripper_yaw_w_rad / 2
        telemetry = SimpleNamespace(
            gripper_position_w_m=[x + off[0], y + off[1], z], gripper_quaternion_w=[np.cos(half), 0, 0, np.sin(half)],
            force_reference_w_n=[1.0, 2.0, 3.0], slip_friction=slipped if number == 1 else 0.0,
        )  # fmt: skip
        limbs.append((SimpleNamespace(phase=0, load=1.0), telemetry))
    at_s = plan.knots[knot].time_s
    state = SimpleNamespace(
        plan_time_s=at_s + 0.1, verified_time_s=at_s + 0.05, time_s=3.0, supervisor_state=robot_state_t.CLIMBING,
        motion=robot_state_t.FORWARD,
    )  # fmt: skip
    return SimpleNamespace(state=state, reference=[r for r, _ in limbs], telemetry=[t for _, t in limbs])


def test_what_is_within_what_measuring_makes_of_it_is_as_on_the_map(plan: plan_t) -> None:
    k = stances(plan)[1]
    assert found_holds(plan, status_of(plan, k, (0.003, -0.003))) == []
    (found,) = found_holds(plan, status_of(plan, k, (0.012, 0.0)))
    assert found.shift_m == pytest.approx((0.012, 0.0))
    assert (found.limb, found.turned_rad, found.friction) == ("RF", 0.0, None)
    (found,) = found_holds(plan, status_of(plan, k, slipped=0.4))
    assert (found.shift_m, found.friction) == ((0.0, 0.0), 0.4)
    held = plan.holds[plan.knots[k].limbs[1].hold].name
    assert str(found) == f"{held} under RF friction 0.40"


def test_the_map_has_the_holds_as_they_were_found(plan: plan_t) -> None:
    name = plan.holds[0].name
    before = load_scenario(SCENES / "climb-four-holds.yaml").holds[0]
    after = scenario_with(plan, [Found("RF", name, (0.01, -0.004), 0.05, 0.3)])
    moved = after.holds[after.hold_index(name)]
    assert np.subtract(moved.position_m, before.position_m) == pytest.approx([0.01, -0.004])
    assert moved.yaw_rad - before.yaw_rad == pytest.approx(0.05)
    assert max(moved.friction) == pytest.approx(0.3)


class Link:
    """A runtime that takes what it is given."""

    def __init__(self) -> None:
        self.taken: list[plan_t] = []

    def upload(self, plan: plan_t) -> None:
        self.taken.append(plan)


def test_what_comes_too_late_leaves_the_climb_as_it_was(plan: plan_t) -> None:
    link, said = Link(), list[str]()
    one = Replanner(link, plan, load_robot("scaler"), said.append)  # type: ignore[arg-type]
    k, after = stances(plan)[1:3]
    looks = iter([status_of(plan, k, (0.012, 0.0)), status_of(plan, after - 1)])
    one.attend(lambda: next(looks))
    assert not link.taken
    assert one.plan is plan
    assert "too late" in said[0]
    assert [(each.kept, each.from_s) for each in one.made] == [(False, plan.knots[after].time_s)]
    later = status_of(plan, k, (0.012, 0.0))
    later.state.verified_time_s += 0.5
    one.attend(lambda: later)
    assert len(one.made) == 1  # a stance is looked at once


def test_on_holds_as_on_the_map_nothing_is_planned_again(plan: plan_t, monkeypatch: pytest.MonkeyPatch) -> None:
    link = Link()
    one = Replanner(link, plan, load_robot("scaler"), lambda _: None)  # type: ignore[arg-type]
    monkeypatch.setattr(replanner, "Planner", None)
    one.attend(lambda: status_of(plan, stances(plan)[1]))
    assert not one.made


class Runtime(Link):
    """One that says where its robot is, one look after the other."""

    def __init__(self, looks: list[Any]) -> None:
        super().__init__()
        self.looks, self.status = looks, None

    def command(self, _: int) -> Any:
        self.status = self.looks.pop(0) if self.looks else None
        return None if self.status is None else SimpleNamespace(plan_id="1")


def test_beside_a_robot_it_goes_on_until_the_plan_ends(plan: plan_t, tmp_path: Path) -> None:
    k = stances(plan)[1]
    looks = [status_of(plan, k, (0.012, 0.0)) for _ in range(4)]
    for number, look in enumerate(looks):
        look.state.plan_complete = int(number == 3)
    runtime = Runtime(looks)
    beside(runtime, plan, tmp_path / "plan.mcap", sleep=lambda _: None)
    assert not runtime.looks
    assert len(runtime.taken) == 1  # of the looks at one stance
    assert runtime.taken[0].method.startswith("replanned: ")
    with pytest.raises(WorkFailed, match="does not answer"):
        beside(Runtime([]), plan, tmp_path / "plan.mcap", sleep=lambda _: None)


@pytest.mark.parametrize("options", [("--guide",), ("--bus", "udp")])
def test_who_plans_again_is_alone_with_a_runtime_in_this_process(
    options: tuple[str, ...], plan: plan_t, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_plan(tmp_path / "plan.mcap", plan)
    assert climb_here(tmp_path / "plan.mcap", tmp_path / "log.mcap", "--replan", *options)[0] == 2
    assert "--replan: with --bus memory, one plan and without --guide" in capsys.readouterr().err
