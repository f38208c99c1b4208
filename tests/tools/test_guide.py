"""A guide beside a runtime in physics: a hold breaks in stance, and another plan leads on, or it says why none does."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from crux_contracts.channels import FAULTS
from crux_contracts.plan_file import plan_id, write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_msgs import limb_knot_t, plan_t, robot_state_t, status_t
from crux_planner.model.arrays import Array
from crux_simulation.benchmarks.world_faults import START_S
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.ports import run_ports
from crux_simulation.sim.world_file import parse_world
from crux_tools.cli import main
from crux_tools.guide.guide import Attended, Guide
from crux_tools.guide.situation import Situation
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry.channels import Channels, read_channels
from shared_plans import SharedPlans
from short_climb import with_a_spare_hold

SCENES = Path(__file__).parents[2] / "msgs" / "scenarios"
RF, RR, TRACK, CLOSE = 1, 3, 1, 6
IDLE, READY, CLIMBING, HOLDING = 0, 1, 2, 3


@pytest.fixture(scope="module")
def plan(planned: SharedPlans) -> plan_t:
    """The wall of four holds a side; all limbs are in stance when the hold breaks."""
    made: plan_t = planned(load_scenario(SCENES / "climb-four-holds.yaml"), load_robot("scaler")).plan
    return made


@pytest.fixture(scope="module")
def short(planned: SharedPlans) -> plan_t:
    """One step of LF; RR has another hold to go to."""
    made: plan_t = planned(with_a_spare_hold(), load_robot("scaler")).plan
    return made


def in_stance_s(plan: plan_t) -> float:
    """A time [s] at which all limbs are in stance: early in the plan's first interval."""
    return START_S + plan.knots[1].time_s / 4


def phases(channels: Channels) -> tuple[Array, Array]:
    """Times [s] (n) and what the limbs do then (n, 4)."""
    phase = channels.tables["/limb_reference"]["phase"].reshape(-1, 4)
    time_s = channels.tables["/robot_state"]["time_s"]
    return time_s[np.arange(len(phase)) * len(time_s) // len(phase)], phase


def guided(plan: plan_t, log: Path, hold: str, breaks_s: float) -> tuple[ClimbResult, Channels]:
    holds = f"{{{hold}: {{breaks_at_s: {breaks_s}}}}}"
    world = parse_world(f"version: 1\nname: test\nholds: {holds}\n".encode()).draw(0, plan)
    result = climb(plan, load_robot("scaler"), log, ClimbOptions(world=world, guide=True))
    return result, read_channels(log)


def test_a_hold_breaks_in_stance_and_the_robot_goes_on_to_its_goal(
    short: plan_t, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.mcap"
    result, channels = guided(short, log, "right-rear-low", in_stance_s(short))
    said = capsys.readouterr().err
    assert result.ok, result.reason
    assert result.verdict.goal_error_m < 0.006
    assert "RR node 7 (gripper): finger force fell" in said
    assert "right-rear-low is no hold any more" in said
    state, output = channels.tables["/robot_state"], channels.tables["/control_output"]
    cycles, now = state["cycle"], state["supervisor_state"]
    began = cycles[np.argmax(now == CLIMBING)]
    assert set(now[cycles >= began].tolist()) == {READY, CLIMBING, HOLDING}
    assert (output["joint_mode"][output["cycle"] >= began] == TRACK).all()
    broke = cycles[np.argmax((now == HOLDING) & (cycles > began))]
    moved_on = cycles[np.argmax((now == CLIMBING) & (cycles > broke))]
    assert moved_on - broke < 1000  # 2 s, of which planning counts as one
    plans = channels.messages["/plan"]
    assert [each.plan_id == short.plan_id for each in plans] == [True, False]
    assert plans[1].method == "guide: grip_lost of RR"
    assert plans[1].knots[0].limbs[RR].phase == limb_knot_t.AIR
    assert recompute(log).ok


@pytest.mark.sweep
def test_fingers_that_close_when_another_hold_breaks_are_waited_for(plan: plan_t, tmp_path: Path) -> None:
    climb(plan, load_robot("scaler"), tmp_path / "whole.mcap", ClimbOptions())
    time_s, phase = phases(read_channels(tmp_path / "whole.mcap"))
    closing_s = time_s[np.argmax(phase[:, RF] == CLOSE)] + 0.3  # of some 1.1 s, after which it only waits
    result, channels = guided(plan, tmp_path / "log.mcap", "left-rear-low", closing_s)
    state = channels.tables["/robot_state"]
    holds_s = state["time_s"][np.argmax((state["supervisor_state"] == HOLDING) & (state["time_s"] > closing_s))]
    time_s, phase = phases(channels)
    assert phase[np.searchsorted(time_s, holds_s), RF] == CLOSE
    assert result.ok, result.reason
    assert result.guide is not None
    assert result.guide["plans"] == 1


def test_with_no_other_hold_in_reach_it_says_so_and_the_robot_stays(
    short: plan_t, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = yaml.safe_load(short.scenario_yaml)
    high = next(hold for hold in content["holds"] if hold["name"] == "right-rear-high")
    high["position_m"] = [0.6, 0.6]  # on the guide's map alone
    lonely = plan_t.decode(short.encode())
    lonely.scenario_yaml = yaml.safe_dump(content)
    lonely.plan_id = plan_id(lonely)
    result, channels = guided(lonely, tmp_path / "log.mcap", "right-rear-low", in_stance_s(lonely))
    said = capsys.readouterr().err
    assert not result.ok
    assert "no way to the goal" in said
    assert "the robot stays where it is" in said
    assert len(channels.messages["/plan"]) == 1
    truth = channels.tables["/truth/body"]
    stands = truth["position_w_m"][truth["cycle"] > in_stance_s(lonely) * 500]
    assert np.ptp(stands, axis=0).max() < 0.02


@pytest.mark.sweep
def test_without_the_guide_in_mid_plan_the_plan_is_finished(
    plan: plan_t, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attend, looks = Guide.attend, list[Attended]()

    def once(self: Guide) -> Attended:
        if Attended.STARTED in looks:
            raise AssertionError("the guide is gone")
        looks.append(attend(self))
        return looks[-1]

    monkeypatch.setattr(Guide, "attend", once)
    result, _ = guided(plan, tmp_path / "log.mcap", "right-rear-low", in_stance_s(plan))
    assert looks[-1] is Attended.STARTED
    assert result.ok, result.reason


def test_a_goal_that_asks_for_a_lost_hold_is_named(plan: plan_t, monkeypatch: pytest.MonkeyPatch) -> None:
    situation = Situation(plan, status_t(), load_robot("scaler"))
    monkeypatch.setattr(Situation, "useless", lambda _: {"right-rear-high": RR, "right-rear-low": RR})
    assert situation.wanted_in_vain() == ["RR on right-rear-high"]


def test_a_hold_is_struck_off_only_when_a_limb_has_missed_it_twice(plan: plan_t) -> None:
    status = status_t()
    for reference, telemetry in zip(status.reference, status.telemetry, strict=True):
        reference.load, telemetry.force_reference_w_n = 1.0, [1.0, 0.0, 0.0]
    status.fault.code, status.fault.limb = 29, RF  # hold_missing
    status.reference[RF].phase = CLOSE
    once = Situation(plan, status, load_robot("scaler"))
    missed = once.missed()
    assert missed is not None
    assert once.useless() == {}
    assert replace(once, missed_before=frozenset({missed})).useless() == {missed: RF}
    assert replace(once, missed_before=frozenset({"left-front-high"})).useless() == {}


def test_no_hold_is_struck_off_on_the_word_of_a_limb_alone_while_another_grip_has_moved(plan: plan_t) -> None:
    status = status_t()
    for reference, telemetry in zip(status.reference, status.telemetry, strict=True):
        reference.phase, reference.load, telemetry.force_reference_w_n = 0, 1.0, [1.0, 0.0, 0.0]
    status.fault.code, status.fault.limb = 29, RF  # hold_missing
    status.reference[RF].phase = CLOSE
    situation = Situation(plan, status, load_robot("scaler"))
    hold = situation.missed()
    assert hold is not None
    again = replace(situation, missed_before=frozenset({hold}))
    status.telemetry[0].stance_shift_g_m = [0.0, 0.012, 0.009]  # a hold that has crept under LF
    assert again.missed() is None
    assert again.useless() == {}
    status.telemetry[0].stance_shift_g_m = [0.0, 0.004, 0.0]  # as joints that were homed wrongly show
    assert again.useless() == {hold: RF}


def test_a_body_turned_to_where_a_gripper_may_just_turn_under_it_is_a_start_of_a_plan(plan: plan_t) -> None:
    robot, status = load_robot("scaler"), status_t()
    status.fault.code = 20  # ft_implausible
    yaws = [limb.gripper_yaw_w_rad for limb in plan.knots[0].limbs]
    for reference, telemetry, grips in zip(status.reference, status.telemetry, plan.knots[0].limbs, strict=True):
        yaw = reference.gripper_yaw_w_rad = grips.gripper_yaw_w_rad
        telemetry.gripper_quaternion_w = [np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)]
        telemetry.gripper_position_w_m = grips.gripper_position_w_m
    for beyond_rad in (max(yaws) - robot.grasp.gripper_yaw_rad[1], min(yaws) - robot.grasp.gripper_yaw_rad[0]):
        turned = beyond_rad * 1.0001  # a fiftieth of a degree further than the gripper may turn
        status.state.body_quaternion_w = [np.cos(turned / 2), 0.0, 0.0, np.sin(turned / 2)]
        body_yaw = Situation(plan, status, robot).scenario().start.body.rpy_rad[2]
        assert body_yaw == pytest.approx(turned, abs=0.011)
        assert all(robot.grasp.gripper_yaw_rad[0] < yaw - body_yaw < robot.grasp.gripper_yaw_rad[1] for yaw in yaws)


def test_it_waits_until_an_operator_has_cleared_what_another_plan_does_not_help_with(plan: plan_t) -> None:
    said = list[str]()
    link = SimpleNamespace(status=status_t(), command=lambda _: SimpleNamespace(plan_id=plan.plan_id))
    guide = Guide(link, plan, load_robot("scaler"), said.append)  # type: ignore[arg-type]
    state, fault = link.status.state, link.status.fault
    state.supervisor_state, fault.code = HOLDING, next(f.code for f in FAULTS if f.name == "cycle_late")
    looks = []
    for state.time_s in (0.0, 10.0, 11.0, 12.0):
        looks.append(guide.attend())
    assert looks == [Attended.WAITING, *[Attended.OPERATOR] * 3]
    assert len(said) == 2
    assert "waiting until an operator clears it" in said[1]
    fault.code = 0
    assert guide.attend() is Attended.NOTHING
    state.supervisor_state = CLIMBING
    assert guide.attend() is Attended.NOTHING
    state.supervisor_state, state.plan_complete = HOLDING, True
    assert guide.attend() is Attended.DONE


@pytest.mark.parametrize(("motion", "settles_s"), [(robot_state_t.FORWARD, 0.3), (robot_state_t.REVERSE, 7.0)])
def test_it_waits_until_the_robot_has_stood_for_a_while(plan: plan_t, motion: int, settles_s: float) -> None:
    """Longer where a limb may be on its way to a hold; from anew where the plan's clock has moved."""
    link = SimpleNamespace(status=status_t(), command=lambda _: SimpleNamespace(plan_id=plan.plan_id))
    guide = Guide(link, plan, load_robot("scaler"), lambda _: None)  # type: ignore[arg-type]
    state, fault = link.status.state, link.status.fault
    fault.code = next(f.code for f in FAULTS if f.name == "cycle_late")  # about which nothing is planned
    state.supervisor_state, state.motion = HOLDING, motion
    looks = []
    for plan_time_s, since_s in ((1.0, 0.0), (1.0, settles_s - 0.01), (1.1, settles_s), (1.1, 2 * settles_s - 0.01)):
        state.plan_time_s, state.time_s = plan_time_s, 100.0 + since_s
        looks.append(guide.attend())
    assert looks == [Attended.WAITING] * 4
    state.time_s = 100.0 + 2 * settles_s + 1e-6
    assert guide.attend() is Attended.OPERATOR


def test_no_runtime_and_no_terminal_are_told(
    plan: plan_t, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_plan(tmp_path / "plan.mcap", plan)
    with run_ports() as ports:
        assert main(["guide", str(tmp_path / "plan.mcap"), "--lcm", ports.lcm_url]) == 1
    assert f"no runtime answers on {ports.lcm_url}" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    assert main(["guide", str(tmp_path / "plan.mcap"), "--ask"]) == 2
    assert "--ask: standard input is no terminal" in capsys.readouterr().err
