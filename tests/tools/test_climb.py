"""Whole climbs: runtime process, CAN frames over UDP, firmware cores, physics, verdict. Needs the build."""

from __future__ import annotations

import hashlib
import re
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from climbs import climb_here, finish_climb, messages, saved, start_climb
from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.robot import ROBOTS, load_robot
from crux_tools.cli import main
from crux_tools.errors import WorkFailed
from crux_tools.paths import SCENARIOS
from crux_tools.replay import recompute
from crux_tools.telemetry.can_frames import read_can_frames
from crux_tools.telemetry.cdr_table import fixed_dtype
from crux_tools.telemetry.channels import read_payloads
from crux_tools.telemetry.reader import read_log
from crux_tools.telemetry.summary import summarise
from hand_plan import Wall, climbing_plan, finish, standing_plan

KEYS = {"ok", "reached_goal", "fell", "slips", "tracking", "real_time_factor", "missed_cycles", "log"}
Climb = tuple[int, dict[str, Any], Path]  # exit status, result, log


@cache
def counted(identifier: int) -> bool:
    """Its payload begins with a counter and a checksum over it."""
    return any(signal.name == "Counter" for signal in can_codec.database().get_message_by_frame_id(identifier).signals)


def frames(log: Path) -> dict[int, list[tuple[int, int, int, bytes]]]:
    """The CAN frames of each bus but for their stamps: cycle, direction, identifier and payload. Between buses their
    order is that of reading; counters, and checksums over them, tell as well how often the runtime had to ask until all
    nodes were there."""
    found = read_can_frames(log)
    columns = (found.bus.tolist(), found.cycle.tolist(), found.direction.tolist(), found.identifier.tolist())
    on: dict[int, list[tuple[int, int, int, bytes]]] = {}
    for row, (bus, *frame) in enumerate(zip(*columns, strict=True)):
        payload = found.payload(row)
        on.setdefault(bus, []).append((*frame, payload[3:] if counted(frame[-1]) else payload))
    return on


@pytest.fixture(scope="module")
def one_limb(tmp_path_factory: pytest.TempPathFactory) -> Climb:
    """LF goes to its next hold, in one process."""
    folder = tmp_path_factory.mktemp("one_limb")
    plan, log = saved(folder, climbing_plan(limbs_to_move=(0,))), folder / "new" / "log.mcap"
    return *finish_climb(start_climb(plan, log, "--bus", "memory")), log


def test_a_limb_moves_to_its_next_hold(one_limb: Climb, monkeypatch: pytest.MonkeyPatch) -> None:
    status, result, log = one_limb
    assert status == 0, result
    assert result.keys() >= KEYS
    assert result["ok"]
    assert result["reached_goal"]
    assert not result["fell"]
    assert result["slips"] == 0
    assert result["tracking"]["body_m"] <= 0.010
    assert result["tracking"]["finger_m"] <= 0.010
    assert 0.0 < result["tracking"]["force_N"] <= 1.5
    assert result["missed_cycles"] == 0
    assert result["real_time_factor"] > 0
    assert result["log"] == str(log)
    says_which_joints_carry_more_than_is_advised(result["joint_notes"], log)
    said = read_log(log).metadata
    assert said["seed"] == "0"
    assert said["crux_commit"] == said["commit"]
    assert "climb" in said["crux_command_line"]
    phases = read_log(log).references["phase"]
    assert set(np.unique(phases[:, 0])) == set(range(8))  # LF went through every phase of a swing
    assert set(np.unique(phases[:, 1:])) == {0}
    compare_again(log, monkeypatch)


def says_which_joints_carry_more_than_is_advised(notes: list[str], log: Path) -> None:
    """As many as there are, and the worst of them."""
    told, robot = read_log(log), load_robot("scaler")
    climbing = told.state["supervisor_state"] == 2
    rms = np.sqrt((told.inputs["joint_torque_nm"][climbing] ** 2).mean(axis=0))
    share = rms / np.tile(robot.servo.continuous_torque_Nm, 4)
    (note,) = [each for each in notes if "makers" in each]
    limb, joint = divmod(int(share.argmax()), 6)
    worst = f"{LIMB_NAMES[limb]} joint{joint + 1} {rms[share.argmax()]:.1f} of "
    assert f": {(share > 1).sum()} of 24 joints, worst {worst}" in note


def compare_again(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The runtime's core gives the log's outputs again to the bit, and others where it is given others.

    It takes the log's own robot description: what has become of the one on this machine does not matter.
    """
    robots = log.with_name("robots")
    shutil.copytree(ROBOTS, robots)
    description = robots / "scaler" / "robot.yaml"
    description.write_text(description.read_text().replace("body_gain_1_s: 1.0", "body_gain_1_s: 1.1"))
    with monkeypatch.context() as patch:
        patch.setattr("crux_contracts.robot.ROBOTS", robots)
        assert load_robot("scaler").hash != read_log(log).metadata["robot_sha256"]
        same = recompute.recompute(log)
    assert same.ok
    assert same.cycles == len(read_log(log).time_s)
    told = read_payloads(log, {"/plan", "/control_input", "/control_output", "/robot_state"})
    monkeypatch.setattr("crux_tools.replay.recompute.read_payloads", lambda *_: told)
    monkeypatch.setattr("crux_tools.replay.recompute.payload_blocks", lambda *_: [(told, 1.0)])
    cycle = 2500
    for topic in ("/control_input", "/control_output", "/robot_state"):
        del told.payloads[topic][cycle + 100 :], told.times_ns[topic][cycle + 100 :]  # the rest takes its time
    inputs = told.payloads["/control_input"]
    layout = fixed_dtype(told.definitions["/control_input"])
    assert layout is not None
    assert layout.fields is not None
    place = layout.fields["joint_position_rad"][1]
    changed = bytearray(inputs[cycle - 1])
    changed[place] ^= 1  # the last bit of one measured angle
    inputs[cycle - 1] = bytes(changed)
    other = recompute.recompute(log).first_difference
    assert other is not None
    assert other.cycle == cycle
    assert other.logged != other.computed
    near = recompute.recompute(log, within=1e-9)
    assert near.ok
    assert 0.0 < near.largest < 1e-9
    plans = told.payloads["/plan"]
    plan, plans[0] = plans[0], b"no plan"
    with pytest.raises(WorkFailed, match="a plan that is no plan_t"):
        recompute.recompute(log)
    plans[0] = plan
    for topic, gone in (("/control_input", cycle - 1), ("/robot_state", cycle - 7)):
        del told.payloads[topic][gone - 1]
        gap = recompute.recompute(log)
        assert (gap.ok, gap.first_difference, gap.missing_cycle, gap.cycles) == (False, None, gone, gone - 1)


def test_a_gain_that_differs_by_one_percent_is_named(
    one_limb: Climb, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, changed = one_limb[2], tmp_path / "scaler"
    shutil.copytree(ROBOTS / "scaler", changed)
    words = ["replay", str(log), "--check", "--robot", str(changed)]
    assert main(words) == 0
    description = changed / "robot.yaml"
    old = description.read_text()
    description.write_text(old.replace("  damping_Ns_m: 400\n", "  damping_Ns_m: 404\n"))
    assert description.read_text() != old
    capsys.readouterr()
    assert main(words) == 1
    assert re.match(r"differs: cycle \d+, /control_output \S+: \S+ in the log, \S+ computed", capsys.readouterr().out)


def test_a_cut_log_is_not_recomputed_without_a_word(
    one_limb: Climb, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part, whole = tmp_path / "part.mcap", one_limb[2].read_bytes()
    part.write_bytes(whole[: len(whole) // 3])
    assert main(["replay", str(part), "--check"]) == 0
    told = capsys.readouterr()
    assert "the same, bit for bit" in told.out
    assert told.err == "crux replay: the end of the file is missing\n"


def test_a_log_without_its_beginning_is_not_called_the_same(
    one_limb: Climb, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part = tmp_path / "part.mcap"
    assert main(["log", "cut", str(one_limb[2]), "-o", str(part), "--from", "1"]) == 0
    capsys.readouterr()
    assert main(["replay", str(part), "--check"]) == 1
    told = capsys.readouterr().out
    assert "cycle 1 is not in the log" in told
    assert "the same" not in told


def test_runs_side_by_side_with_one_seed_log_the_same_and_another_seed_does_not(tmp_path: Path) -> None:
    plan = saved(tmp_path, standing_plan(Wall(dt_s=1.0)))
    logs = [tmp_path / f"{name}.mcap" for name in ("one", "two", "other")]
    runs = [start_climb(plan, log, "--seed", "7") for log in logs[:2]]
    for status, result in (climb_here(plan, logs[2], "--seed", "8"), *map(finish_climb, runs)):
        assert status == 0, result
    one, two, other = map(messages, logs)
    assert one == two
    assert one["/control_input"] != other["/control_input"]
    assert one["/plan"] == other["/plan"]


# Short, for the runtime waits longer in each of few cycles for nodes that a busy machine makes late.
FAULTS = "version: 1\nfaults: [{at_s: 4.0, kind: loss, limb: RF, share: 0.3, for_s: 0.02}]"
WORLD = (
    "version: 1\nname: rough\nholds: {all: {offset_m: {normal: [0, 0.003]}}}\n"
    "robot: {payload: {mass_kg: 0.5}, joints: {all: {backlash_rad: 0.002, setpoint_time_constant_s: 0.03}}}\n"
    "sensors: [{sensor: force_torque, on: all, error: dropout, share: 0.1}]\n"
    "pushes: [{at_s: 5, for_s: 1, force_N: [0, 9, 0]}]\n"
)


@pytest.mark.sweep
@pytest.mark.parametrize("given", ["", "faults", "world"])
def test_one_process_and_a_runtime_of_its_own_log_the_same(given: str, one_limb: Climb, tmp_path: Path) -> None:
    file = tmp_path / "given.yaml"
    file.write_text(WORLD if given == "world" else FAULTS)
    options = {"": [], "faults": ["--faults", str(file)], "world": ["--world", str(file), "--world-seed", "5"]}[given]
    plan = saved(tmp_path, climbing_plan(limbs_to_move=(0,)))
    logs = {bus: tmp_path / f"{bus}.mcap" for bus in (("memory", "udp") if given else ("udp",))}
    runs = {bus: start_climb(plan, log, "--bus", bus, *options) for bus, log in logs.items()}
    results = {"memory": one_limb[1], **{bus: finish_climb(run)[1] for bus, run in runs.items()}}
    assert results["memory"].get("faults") == results["udp"].get("faults")
    assert ("faults" in results["udp"]) == (given == "faults")
    plain = messages(one_limb[2])
    memory, udp = messages(logs["memory"]) if given else plain, messages(logs["udp"])
    assert memory.keys() == udp.keys()
    assert {topic for topic in memory if memory[topic] != udp[topic]} == set(), options
    assert frames(logs.get("memory", one_limb[2])) == frames(logs["udp"])
    assert len(memory["/control_input"]) > 4000
    assert len(memory["/truth/contacts"]) > 800
    assert (memory["/control_input"] == plain["/control_input"]) == (given == "")
    if given == "world":
        tags = read_log(logs["udp"]).metadata
        assert (tags["world"], tags["world_seed"]) == ("rough", "5")
        assert tags["world_sha256"] == hashlib.sha256(WORLD.encode()).hexdigest()


def test_one_process_and_a_runtime_of_its_own_log_the_same_of_a_robot_that_loses_frames(tmp_path: Path) -> None:
    """Before, while and after they are lost; the robot stands."""
    file, plan = tmp_path / "faults.yaml", saved(tmp_path, standing_plan(Wall(dt_s=1.0)))
    file.write_text(FAULTS.replace("4.0", "1.5"))
    logs = {bus: tmp_path / f"{bus}.mcap" for bus in ("memory", "udp")}
    run = start_climb(plan, logs["udp"], "--bus", "udp", "--faults", str(file))
    one = climb_here(plan, logs["memory"], "--bus", "memory", "--faults", str(file))[1]
    other = finish_climb(run)[1]
    assert one["faults"] == other["faults"]
    memory, udp = map(messages, logs.values())
    assert memory.keys() == udp.keys()
    assert {topic for topic in memory if memory[topic] != udp[topic]} == set()
    assert frames(logs["memory"]) == frames(logs["udp"])
    assert len(memory["/control_input"]) > 1000


def test_a_motor_that_overheats_in_its_world_is_seen_by_its_node(tmp_path: Path) -> None:
    """From the torque in physics by the node's thermometer over the bus to the runtime's fault."""
    world = tmp_path / "world.yaml"
    world.write_text("version: 1\nname: hot\nrobot: {joints: {RF.2: {heating_K_Nm2: 100, heating_time_s: 3}}}\n")
    log = tmp_path / "log.mcap"
    plan = saved(tmp_path, climbing_plan(limbs_to_move=(0,)))
    status, result = climb_here(plan, log, "--world", str(world))
    assert status == 1
    (fault,) = summarise(read_log(log)).faults
    assert (fault.code, fault.limb) == (2, "RF")
    assert result["cycles"] * 0.002 - fault.time_s > 10.0  # watched on
    assert "node_fault" in result["reason"]


def test_slow_position_loops_of_a_world_let_grippers_lag(one_limb: Climb, tmp_path: Path) -> None:
    world, plan = tmp_path / "world.yaml", saved(tmp_path, climbing_plan(limbs_to_move=(0,)))
    world.write_text("version: 1\nname: slow\nrobot: {joints: {all: {setpoint_time_constant_s: 0.1}}}\n")
    slow = climb_here(plan, tmp_path / "slow.mcap", "--world", str(world))[1]
    assert slow["tracking"]["finger_m"] > 2 * one_limb[1]["tracking"]["finger_m"]


@pytest.mark.parametrize("slope_deg", [45.0, 180.0])
def test_a_wall_too_smooth_for_the_robot_is_a_failed_climb(slope_deg: float, tmp_path: Path) -> None:
    smooth = standing_plan(Wall(slope_deg=slope_deg, friction=(0.1,) * 5, spines=(0,) * 5))
    status, result = climb_here(saved(tmp_path, smooth), tmp_path / "log.mcap")
    assert status == 1
    assert result["ok"] is False
    assert result["reason"]
    assert result["slips"] > 0 or result["fell"]
    assert result["fell"] or slope_deg < 90.0


@pytest.mark.sweep
@pytest.mark.parametrize("slope_deg", [130.0, 150.0, 180.0])
def test_overhangs_and_a_ceiling_are_climbed(slope_deg: float, tmp_path: Path) -> None:
    wall = (SCENARIOS / "climb-ceiling.yaml").read_text(encoding="utf-8").replace("180", f"{slope_deg:g}")
    (tmp_path / "wall.yaml").write_text(wall, encoding="utf-8")
    assert main(["plan", str(tmp_path / "wall.yaml"), "-o", str(tmp_path / "plan.mcap")]) == 0
    status, result = climb_here(tmp_path / "plan.mcap", tmp_path / "log.mcap")
    assert (status, result["slips"], result["fell"]) == (0, 0, False)


def test_a_plan_for_another_robot_is_refused(tmp_path: Path) -> None:
    plan = finish(Wall(), standing_plan().knots, robot_sha256="0" * 64)
    log = tmp_path / "log.mcap"
    status, result = climb_here(saved(tmp_path, plan), log)
    assert status == 2
    assert all(word in result["error"] for word in ("robot_sha256", "000000000000", "scaler", "plan it again"))
    assert not log.exists()
