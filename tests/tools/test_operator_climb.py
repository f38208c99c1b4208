"""An operator's single steps, reverse and speed in physics: runtime, firmware cores and plant in one process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from crux_contracts import channels
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import load_robot
from crux_msgs import acknowledgement_t, command_t, limb_knot_t, plan_t, robot_state_t
from crux_simulation.sim.climb import ClimbOptions, plant_of
from crux_simulation.sim.disturbance import STATE_MASK
from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.judge import SLIP_M, judge
from crux_simulation.sim.loop import START_CYCLE, climbing
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.recorder import recorded
from crux_simulation.sim.runtime_here import RuntimeHere
from crux_simulation.sim.runtime_process import runtime_arguments
from crux_simulation.sim.world_file import parse_world
from crux_tools.errors import UsageError
from crux_tools.operator_link import OperatorLink
from crux_tools.operator_status import status_json, status_lines
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry.channels import read_channels
from crux_tools.telemetry.reader import read_log
from crux_tools.telemetry.summary import summarise
from hand_plan import climbing_plan

MOST_CYCLES = 60_000
LF = 0
K0 = 5  # the plan's knot at which LF releases its hold
TRACK = 1  # NodeMode
GRIP_LOST = 9  # msgs/faults.yaml
LIFTS_S, ON_NEW_HOLD_S, STANCE_S = 5.0, 11.42, 4.0  # of the plan: LF releases, bears again; the stance before
BACK_M = 0.002  # where a robot stands that came back, against where it stood


@dataclass
class Operated:
    """A robot on its wall with a runtime, and who operates it."""

    plant: Plant
    nodes: FirmwareNodes
    runtime: RuntimeHere
    link: OperatorLink
    log: Path
    cycle: int = field(default=-1, init=False)
    _request: int = field(default=1000, init=False)

    def cycles(self, count: int) -> None:
        """Lets so many control cycles pass."""
        end = self.cycle + count
        while self.cycle < end:
            cycle = self.nodes.wait_sync(1.0)
            assert cycle is not None
            if cycle != self.cycle:
                self.nodes.step(self.plant)
                self.plant.record(cycle, climbing(self.nodes.host_state()))
            self.nodes.publish(self.plant)
            self.cycle = cycle

    def order(self, command: int, value: float = 0.0, plan_id: str = "") -> str:
        """The runtime's reason where it refuses, else nothing."""
        message = command_t()
        self._request += 1
        message.request_id, message.command, message.value, message.plan_id = self._request, command, value, plan_id
        self.link._answers.ask(channels.CRUX_COMMAND, message.encode())
        self.cycles(2)
        answer = self.link._await(lambda a: a.request_id == message.request_id, 600.0)
        assert answer is not None
        assert (answer.verdict == acknowledgement_t.ACCEPTED) == (answer.reason == "")
        return str(answer.reason)

    def state(self) -> robot_state_t:
        """The runtime's newest."""
        self.cycles(10)
        self.link.send(command_t.STATUS)
        assert self.link.status is not None
        return self.link.status.state

    def until_holding(self) -> robot_state_t:
        """Lets the robot climb until it holds."""
        for _ in range(MOST_CYCLES // 50):
            self.cycles(50)
            if self.nodes.host_state() & STATE_MASK != robot_state_t.CLIMBING:
                break
        state = self.state()
        assert state.supervisor_state == robot_state_t.HOLDING
        return state

    def climb_to(self, plan_time_s: float) -> None:
        """Lets it climb until plan time, then holds."""
        for _ in range(MOST_CYCLES // 10):
            if self.state().plan_time_s >= plan_time_s:
                break
        assert self.order(command_t.HOLD) == ""

    def body_m(self) -> np.ndarray:
        """Where the body really is."""
        return np.array(recorded(self.plant).body_position_m[-1])


@contextmanager
def operated(plan: plan_t, log: Path, world: str = "") -> Iterator[Operated]:
    """The plan is loaded, the hand has released the robot; `world`: what is otherwise than the plan says."""
    robot = load_robot("scaler")
    drawn = parse_world(f"version: 1\nname: test\n{world}".encode()).draw(0, plan) if world else None
    with ExitStack() as stack:
        plant = plant_of(plan, robot, ClimbOptions(world=drawn))
        nodes = stack.enter_context(FirmwareNodes(["memory:"] * 4, robot))
        runtime = stack.enter_context(RuntimeHere(nodes, runtime_arguments(robot.folder, log, "each", {})))
        link = stack.enter_context(OperatorLink(connection=runtime))
        link.upload(plan)
        run = Operated(plant, nodes, runtime, link, log)
        run.cycles(START_CYCLE)
        yield run


@pytest.fixture(scope="module")
def plan() -> plan_t:
    """LF goes to its next hold; of its knots only those of the swing are no stances."""
    return climbing_plan(limbs_to_move=(LF,))


def end(run: Operated, plan: plan_t) -> None:
    """No slip, no fall and no fault in the whole run, and its log computes again to the bit."""
    truth = recorded(run.plant)
    verdict = judge(truth, plan, run.plant.robot, complete=False)
    assert not verdict.fell, verdict.fall_reason
    assert verdict.largest_slip_m < SLIP_M
    run.runtime.wait()
    assert summarise(read_log(run.log)).faults == []
    assert recompute(run.log).ok


def test_from_mid_swing_the_robot_goes_back_to_its_stance_and_then_on_to_the_goal(plan: plan_t, tmp_path: Path) -> None:
    with operated(plan, tmp_path / "log.mcap") as run:
        before_m = run.body_m()
        assert run.order(command_t.START, plan_id=plan.plan_id) == ""
        run.climb_to(LIFTS_S + 1.5)
        assert not run.plant.limbs_on_holds()[LF]
        assert run.order(command_t.REVERSE) == ""
        assert climbing(run.nodes.host_state()) == -1
        state = run.until_holding()
        assert state.plan_time_s == pytest.approx(STANCE_S)
        assert state.verified_time_s == pytest.approx(STANCE_S)
        assert run.plant.limbs_on_holds().all()
        while state.verified_time_s > 0:
            assert run.order(command_t.REVERSE) == ""
            state = run.until_holding()
        assert np.linalg.norm(run.body_m() - before_m) < BACK_M
        assert "no verified stance" in run.order(command_t.REVERSE)
        assert run.order(command_t.RESUME) == ""
        state = run.until_holding()
        assert state.plan_complete == 1
        assert run.plant.limbs_on_holds().all()
        end(run, plan)


def test_step_by_step_onto_the_new_hold_and_at_half_the_speed_back_to_the_old_one(plan: plan_t, tmp_path: Path) -> None:
    with operated(plan, tmp_path / "log.mcap") as run:
        assert "1.5" in run.order(command_t.SPEED, 1.5)
        speed, stops_s = 0.5, list[float]()
        assert run.order(command_t.SPEED, speed) == ""
        while not stops_s or stops_s[-1] < ON_NEW_HOLD_S - 0.1:
            began = run.cycle
            assert run.order(command_t.STEP, plan_id=plan.plan_id) == ""
            state = run.until_holding()
            assert run.plant.limbs_on_holds().all()
            took_s = (run.cycle - began) * run.plant.dt_s
            assert took_s >= (state.plan_time_s - (stops_s[-1] if stops_s else 0.0)) / speed
            stops_s.append(state.plan_time_s)
            if state.plan_time_s >= STANCE_S - 0.1 and speed < 1.0:
                speed = 1.0  # the judge does not know of it
                assert run.order(command_t.SPEED, speed) == ""
        assert stops_s == pytest.approx([1.0, 2.0, 3.0, STANCE_S, ON_NEW_HOLD_S])
        lf_m = np.array(run.plant.data.site_xpos[run.plant.robot.gripper_sites[LF]])
        answer = run.link.send(command_t.STATUS)
        told = status_json(answer, run.link.status)
        assert (told["state"], told["motion"], told["speed_scale"]) == ("holding", "single step", 1.0)
        assert told["verified_time_s"] == pytest.approx(ON_NEW_HOLD_S)
        assert {limb["phase"] for limb in told["limbs"].values()} == {"stance"}
        assert all(0.0 < limb["utilisation"] < 1.0 for limb in told["limbs"].values())
        assert all(limb["grasp_force_N"] > 5.0 for limb in told["limbs"].values())
        lines = status_lines(run.link.status)
        assert lines[0].startswith("INSECURE")  # as simulations are
        assert lines[1].startswith(f"plan time {ON_NEW_HOLD_S:.2f} of {plan.knots[-1].time_s:.2f} s, speed 1, single")
        assert run.order(command_t.SPEED, 0.5) == ""
        assert run.order(command_t.REVERSE) == ""
        state = run.until_holding()
        assert state.plan_time_s == pytest.approx(STANCE_S)
        assert run.plant.limbs_on_holds().all()
        moved_m = np.array(run.plant.data.site_xpos[run.plant.robot.gripper_sites[LF]]) - lf_m
        assert moved_m[0] == pytest.approx(-0.13, abs=0.01)
        end(run, plan)
        log = read_log(run.log)
        ordered = log.inputs["operator_command"] == command_t.SPEED
        assert log.inputs["command_value"][ordered].tolist() == [1.5, 0.5, 1.0, 0.5]
        assert not log.inputs["command_value"][~ordered].any()
        assert [command.value for command in log.commands if command.command == command_t.SPEED] == [1.5, 0.5, 1.0, 0.5]
        assert any(span.state == "CLIMBING, in reverse" for span in summarise(log).states)


def rest_from(plan: plan_t, first: int) -> plan_t:
    """The plan from a knot on."""
    rest = plan_t.decode(plan.encode())
    rest.knots = rest.knots[first:]
    for k, knot in enumerate(rest.knots):
        knot.time_s = k * rest.dt_s
    in_air = any(limb.phase == limb_knot_t.AIR for limb in rest.knots[0].limbs)
    rest.format = plan_t.FORMAT_FROM_AIR if in_air else plan_t.FORMAT
    rest.n_knots, rest.plan_id = len(rest.knots), ""
    rest.plan_id = plan_id(rest)
    return rest


def test_with_a_hold_gone_another_plan_is_taken_with_all_joints_controlled_all_the_while(
    plan: plan_t, tmp_path: Path
) -> None:
    log = tmp_path / "log.mcap"
    with operated(plan, log, "holds: {h0: {breaks_at_s: 6.5}}") as run:
        assert run.order(command_t.START, plan_id=plan.plan_id) == ""
        state = run.until_holding()
        assert state.fault_code == GRIP_LOST
        run.runtime.idle = lambda: run.cycles(1)
        with pytest.raises(UsageError, match="LF: the plan starts with this gripper on a hold, but it is in the air"):
            run.link.upload(rest_from(plan, K0 - 1))
        rest = rest_from(plan, K0)
        run.link.upload(rest)
        state = run.state()
        assert (state.supervisor_state, state.fault_code) == (robot_state_t.READY, 0)
        run.cycles(500)
        assert run.link.send(command_t.START, rest.plan_id)
        run.runtime.idle = None
        state = run.until_holding()
        assert state.fault_code == 0
        assert state.plan_complete
        assert run.plant.limbs_on_holds().all()
        run.runtime.wait()
    tables = read_channels(log).tables
    climbed = tables["/robot_state"]["supervisor_state"] == robot_state_t.CLIMBING
    since = tables["/robot_state"]["cycle"][np.argmax(climbed)]
    modes = tables["/control_output"]["joint_mode"][tables["/control_output"]["cycle"] >= since]
    assert (modes == TRACK).all()
    assert recompute(log).ok
