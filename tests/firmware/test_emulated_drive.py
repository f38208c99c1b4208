"""What an emulated joint does when its amplifiers, its motor's wiring or its encoder are not as it believes, judged by
the torque that the motor makes, not by the one that the board says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import pytest
from crux_contracts.can_codec import Values
from crux_contracts.motors import joint_continuous_torque_Nm
from crux_contracts.robot import Robot, load_robot
from crux_simulation.sim import crux_emulated
from crux_tools.can.node_link import NodeLink, Refused, limb_bus, node_name
from crux_tools.can.param_command import describe, write
from emulated import board
from host import HOLD, REARM, TRACK, Host, host
from service_host import Desk

LF = 0
NODE = 2
HOLD_STATE, TRACK_STATE, FAULT_STATE = 1, 2, 4
SENSOR, NOT_CALIBRATED, CURRENTS, DIRECTION, UNCHECKED, ENCODER_ERRORS = 10, 13, 14, 15, 16, 17
RESTARTED = 9
NOT_CALIBRATED_BIT = 1 << 7
GRIPPER_COMMAND = {"Mode": TRACK, "Opening_m": 0.03, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 20.0}
START_RAD = 0.25
INERTIA_KG_M2 = 0.3  # of what hangs on the joint
DAMPING_NMS_RAD = 0.3
QUIET_CYCLES = 120  # until the current of the start has settled and the direction is decided


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


def asking(torque_Nm: float, position_rad: float = START_RAD, mode: int = TRACK) -> Values:
    return {"Mode": mode, "Position_rad": position_rad, "Kp_Nm_rad": 40.0, "Kd_Nms_rad": 1.0, "Torque_Nm": torque_Nm}


@dataclass
class Bench:
    """One emulated joint; its shaft is held, or turns with a load."""

    bus: Host
    emulated: crux_emulated.Board
    free: bool = False
    load_Nm: float = 0.0
    speed_rad_s: float = 0.0
    cycle: int = 0
    torques_Nm: list[float] = field(default_factory=list)
    causes: list[int] = field(default_factory=list)
    status: Values = field(default_factory=dict)

    @property
    def position_rad(self) -> float:
        return float(self.bus.plant.joint_position_rad[NODE - 1])

    def run(self, cycles: int, command: Values) -> None:
        for _ in range(cycles):
            torques_Nm, _ = self.bus.run(self.cycle, command, GRIPPER_COMMAND)
            self.cycle += 1
            torque_Nm = float(torques_Nm[NODE - 1])
            self.torques_Nm.append(torque_Nm)
            heard: Any = self.bus.heard(LF)
            self.causes += [row["Cause"] for row in heard["JointEmergency", NODE]]
            if statuses := heard["JointStatus", NODE]:
                self.status = statuses[-1]
            if self.free:
                push_Nm = torque_Nm + self.load_Nm - DAMPING_NMS_RAD * self.speed_rad_s
                self.speed_rad_s += self.bus.dt_s * push_Nm / INERTIA_KG_M2
                self.bus.plant.joint_position_rad[NODE - 1] += self.bus.dt_s * self.speed_rad_s


@pytest.fixture
def bench(robot: Robot) -> Iterator[Bench]:
    with board(robot, LF, NODE) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        bus.plant.joint_position_rad[:] = START_RAD
        yield Bench(bus, emulated)
        assert emulated.fault == ""


def electrical(robot: Robot, turns: float) -> float:
    """So many electrical turns of the rotor, at the joint [rad]."""
    return turns * 2 * math.pi / robot.motor.pole_pairs / robot.motor.gear_ratio


@pytest.mark.parametrize("stuck_A", [pytest.param(0.0, marks=pytest.mark.sweep), -2.0])
@pytest.mark.parametrize("phase", [0, 1])
@pytest.mark.parametrize("eighth", [0, pytest.param(2, marks=pytest.mark.sweep)])
def test_an_amplifier_that_is_stuck_never_makes_more_than_a_quarter_beyond_the_limit(
    robot: Robot, bench: Bench, phase: int, stuck_A: float, eighth: int
) -> None:
    limit_Nm = robot.limbs[LF].joints[NODE - 1].effort
    at_rad = START_RAD + electrical(robot, eighth / 8)
    bench.bus.plant.joint_position_rad[NODE - 1] = at_rad
    bench.run(QUIET_CYCLES, asking(5.0, at_rad))
    assert bench.torques_Nm[-1] == pytest.approx(5.0, abs=0.1)
    bench.torques_Nm.clear()
    bench.emulated.stick_amplifier(phase, stuck_A)
    bench.run(250, asking(5.0, at_rad))
    beyond = [abs(torque_Nm) > limit_Nm for torque_Nm in bench.torques_Nm]
    assert max(abs(torque_Nm) for torque_Nm in bench.torques_Nm) < 1.25 * limit_Nm
    assert sum(beyond) <= 1  # cycle of 2 ms
    if CURRENTS in bench.causes:
        assert bench.status["State"] == FAULT_STATE
        # The field stands: as strong as the winding bears for good.
        assert abs(bench.torques_Nm[-1]) <= 1.03 * joint_continuous_torque_Nm(robot.motor)
    else:  # what the phase carries here differs too little from what its amplifier says
        assert bench.torques_Nm[-1] == pytest.approx(5.0, abs=0.3 * limit_Nm)


def test_an_amplifier_that_is_stuck_under_load_is_told_within_two_milliseconds(bench: Bench) -> None:
    bench.run(QUIET_CYCLES, asking(5.0))
    bench.emulated.stick_amplifier(1, 0.0)  # which carries three quarters of the current here
    bench.run(1, asking(5.0))
    bench.run(1, asking(5.0))  # what happened in the cycle before is told in this one
    assert bench.status["State"] == FAULT_STATE
    assert bench.causes[-1] == CURRENTS


@pytest.mark.parametrize("degC", [pytest.param(25.0, marks=pytest.mark.sweep), 75.0])
def test_sound_amplifiers_are_believed_whatever_is_asked(bench: Bench, degC: float) -> None:
    bench.free = True
    bench.bus.nodes.set_temperature(LF, NODE, degC)
    bench.run(QUIET_CYCLES, asking(0.0))
    for position_rad, torque_Nm in ((1.0, 12.0), (-1.0, -12.0), (0.25, 0.0)):
        bench.run(200, asking(torque_Nm, position_rad))
    assert bench.status["State"] == TRACK_STATE
    assert {CURRENTS, DIRECTION, SENSOR}.isdisjoint(bench.causes)


def wire_wrongly(emulated: crux_emulated.Board, fault: str) -> None:
    if fault == "phases":
        emulated.swap_phases(True)
    else:
        emulated.turn_magnets(math.pi)


@pytest.mark.parametrize("fault", ["phases", "offset"])
def test_a_motor_that_turns_the_wrong_way_is_found_as_it_is_started(robot: Robot, bench: Bench, fault: str) -> None:
    wire_wrongly(bench.emulated, fault)
    bench.free = True
    bench.run(QUIET_CYCLES, asking(0.0))
    assert bench.status["State"] == FAULT_STATE
    assert bench.causes[-1] == DIRECTION
    # It moved by a few mrad until that was known, and then the magnets locked to a field that stands.
    assert abs(bench.position_rad - START_RAD) < electrical(robot, 1.0)


@pytest.mark.parametrize("fault", ["phases", "offset"])
def test_under_a_load_it_is_found_as_soon_as_the_joint_moves(bench: Bench, fault: str) -> None:
    wire_wrongly(bench.emulated, fault)
    bench.free = True
    bench.load_Nm = -5.0
    told_rad = math.inf
    while bench.cycle < 250:
        bench.run(1, asking(5.0))
        if bench.status["State"] == FAULT_STATE:
            told_rad = min(told_rad, abs(bench.position_rad - START_RAD))
    assert {CURRENTS, DIRECTION} & set(bench.causes)
    assert told_rad < 0.05
    assert abs(bench.speed_rad_s) < 1.0  # what holds it is weaker than a motor that works, but brakes


def test_a_motor_that_turns_the_right_way_is_silent_and_hardly_moves(bench: Bench) -> None:
    bench.free = True
    furthest_rad = 0.0
    for _ in range(QUIET_CYCLES):
        bench.run(1, asking(0.0, mode=HOLD))
        furthest_rad = max(furthest_rad, abs(bench.position_rad - START_RAD))
    assert bench.status["State"] == HOLD_STATE
    assert bench.causes == [RESTARTED]
    assert 0.0 < furthest_rad < 0.002


@pytest.mark.parametrize("moved_rad", [0.0, 0.02])
def test_a_shaft_that_is_locked_or_loaded_leaves_the_direction_unchecked_and_says_so(
    bench: Bench, moved_rad: float
) -> None:
    if moved_rad > 0.0:  # where the board has found and holds it, before a load moves it
        bench.bus.plant.joint_position_rad[NODE - 1] -= moved_rad
        for _ in range(20):
            bench.run(1, asking(0.0, mode=HOLD))
            bench.bus.plant.joint_position_rad[NODE - 1] += moved_rad / 20
    bench.run(QUIET_CYCLES, asking(0.0, mode=HOLD))
    assert bench.status["State"] == HOLD_STATE
    assert bench.causes == [RESTARTED, UNCHECKED]


def test_an_error_flag_of_the_encoder_costs_a_few_samples_and_is_told(bench: Bench) -> None:
    bench.run(QUIET_CYCLES, asking(2.0))
    bench.causes.clear()
    for _ in range(3):
        bench.emulated.flag_encoder()
        bench.run(60, asking(2.0))
        assert bench.status["State"] == TRACK_STATE
        assert bench.torques_Nm[-1] == pytest.approx(2.0, abs=0.05)
    assert bench.causes == [ENCODER_ERRORS] * 3


def test_an_encoder_that_comes_back_is_homed_and_goes_on_after_a_rearm(robot: Robot, bench: Bench) -> None:
    bench.run(QUIET_CYCLES, asking(2.0))
    bench.causes.clear()
    bench.emulated.break_encoder(True)
    bench.run(20, asking(2.0))
    assert bench.status["State"] == FAULT_STATE
    # Further than half a turn of the rotor: where it is now only the coarse encoder knows.
    for _ in range(100):
        bench.bus.plant.joint_position_rad[NODE - 1] += electrical(robot, 0.06)
        bench.run(1, asking(2.0))
    bench.emulated.break_encoder(False)
    bench.run(20, asking(2.0))
    assert bench.status["State"] == FAULT_STATE  # until somebody decides to go on
    assert bench.causes == [ENCODER_ERRORS, SENSOR, ENCODER_ERRORS, ENCODER_ERRORS]
    here_rad = bench.position_rad
    assert here_rad > START_RAD + math.pi / robot.motor.gear_ratio
    bench.run(5, asking(2.0, here_rad, REARM))
    assert bench.status["State"] == HOLD_STATE
    assert bench.status["Position_rad"] == pytest.approx(here_rad, abs=1e-4)
    bench.run(100, asking(2.0, here_rad))
    assert bench.status["State"] == TRACK_STATE
    assert bench.torques_Nm[-1] == pytest.approx(2.0, abs=0.05)


def test_a_blank_board_says_that_it_is_not_calibrated_and_serves(robot: Robot) -> None:
    with board(robot, LF, NODE) as emulated, host(robot) as bus:
        emulated.blank()
        bus.nodes.replace(LF, NODE, emulated.port)
        bench = Bench(bus, emulated)
        bench.run(20, asking(2.0))
        assert bench.causes == [RESTARTED, NOT_CALIBRATED]
        assert bench.status["State"] == FAULT_STATE
        assert bench.status["Faults"] == NOT_CALIBRATED_BIT
        assert bench.torques_Nm[-1] == pytest.approx(0.0, abs=1e-6)
        desk = Desk(bus)
        try:
            name = node_name("LF.2")
            with NodeLink(name, limb_bus(desk.base(), robot, name.limb), 20.0) as joint:
                entry = describe(joint)["setpoint_time_constant_s"]
                write(joint, entry, 0.03)
                assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(0.03)
                desk.joint = asking(2.0)
                desk.await_periods(20)
                with pytest.raises(Refused):
                    joint.restart()  # a host that commands says that the robot may hang on it
                desk.joint = None
                desk.await_periods(20)
                joint.restart()
                assert describe(joint)["setpoint_time_constant_s"].value != pytest.approx(0.03)
        finally:
            desk.end()
        assert emulated.fault == ""
