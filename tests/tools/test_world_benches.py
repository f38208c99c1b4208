"""`crux bench worlds` and `crux bench faults --world`: what is drawn, and what counts as a fall, told, at the goal."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import FAULT_BY_CODE
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_msgs import plan_t
from crux_simulation.benchmarks import world_faults, worlds
from crux_simulation.benchmarks.like_walls import SCATTER_M, YAW_DEG
from crux_simulation.benchmarks.world_faults import (
    BESIDE,
    IN_THE_WORLD,
    KINDS,
    LOSES_A_HOLD,
    OF_THE_RUNTIME,
    RESTARTS,
    SCHEDULED,
    START_S,
    TWO,
    Fault,
    draw_fault,
    ending_of,
    gripped,
    job_of,
)
from crux_simulation.campaign.job import PLAN_FILE, WorldFile
from crux_simulation.sim.fault_file import read_faults
from crux_simulation.sim.world_file import read_world
from crux_tools.cli import main
from crux_tools.paths import SCENARIOS
from hand_plan import climbing_plan, standing_plan
from shared_plans import SharedPlans
from short_climb import with_a_spare_hold


def row(
    verdict: str = "failed", reason: str = "", fell: bool = False, body_m: float = 0.002, lost: tuple[str, ...] = ()
) -> dict[str, Any]:
    return {
        "verdict": verdict,
        "reason": reason,
        "climb": {"fell": fell, "lost_grips": list(lost), "tracking": {"body_m": body_m}},
    }


@pytest.fixture(scope="module")
def plan() -> plan_t:
    """LF goes from hold 0 to hold 4."""
    return climbing_plan(limbs_to_move=(0,))


def test_every_kind_of_fault_comes_by_turns_as_a_file_that_can_be_read(plan: plan_t, tmp_path: Path) -> None:
    count = 3 * len(KINDS)
    faults = [draw_fault(seed) for seed in range(count)]
    assert Counter(fault.kind for fault in faults) == dict.fromkeys(KINDS, 3)
    for number, fault in enumerate(faults):
        if fault.kind == RESTARTS:  # of the bench alone
            continue
        path = tmp_path / f"{number}.yaml"
        path.write_text(fault.text(plan))
        if fault.kind in SCHEDULED:
            (read,) = read_faults(path)
            assert fault.kind.replace("-", "_").startswith(read.kind)
            assert (read.limb >= 0) == bool(fault.limb)
            assert 6.0 <= read.at_s <= START_S + plan.knots[-1].time_s
        else:
            assert read_world(path).name == fault.kind
        of_a_limb = not fault.kind.startswith("hold-") and fault.kind != "slippery-hold"
        assert (fault.limb in LIMB_NAMES) == (of_a_limb and fault.kind not in (*OF_THE_RUNTIME, "power-lost", TWO))
    assert [draw_fault(seed) for seed in range(count)] == faults
    assert len({fault.text(plan) for fault in faults if fault.kind != RESTARTS}) > count - 13


def test_two_at_once_leave_three_limbs_their_holds_and_either_may_be_told(plan: plan_t, tmp_path: Path) -> None:
    faults = [fault for fault in map(draw_fault, range(1000)) if fault.kind == TWO]
    assert len({fault.both[0].kind for fault in faults}) > 5 < len({fault.both[1].kind for fault in faults})
    for fault in faults:
        assert [each.kind in BESIDE for each in fault.both] == [False, True]
        path = tmp_path / "world.yaml"
        path.write_text(fault.text(plan))
        alone = [Fault.text(each, plan) for each in fault.both]
        read = read_world(path).draw(0, plan)
        for text in alone:
            path.write_text(text)
            one = read_world(path).draw(0, plan)
            assert set(one.sensors) <= set(read.sensors)
            assert one.holds.keys() <= read.holds.keys()
    fault = Fault(TWO, "", both=(Fault("hold-creeps", ""), Fault("ft-zero", "RF")))
    for reason, told in (
        ("9.1 s: 22 slip, limb LF, node 7: the gripper slid", True),
        ("9.1 s: 22 slip, limb RR, node 7: the gripper slid", False),
        ("9.1 s: 20 ft_implausible, limb RF, node 7: the joints' torques do not fit", True),
        ("9.1 s: 20 ft_implausible, limb LF, node 7: the joints' torques do not fit", False),
    ):
        end = row(reason=reason)
        end["climb"]["on_holds"] = ["LF", "LR"]
        assert ending_of(end, fault).told == told


def test_holds_go_wrong_that_the_plan_still_grips(plan: plan_t) -> None:
    assert gripped(plan, 0.0) == [0, 1, 2, 3, 4]
    assert gripped(plan, plan.knots[-1].time_s + 9.0) == [1, 2, 3, 4]
    seeds = [seed for seed in range(400) if draw_fault(seed).kind == "hold-breaks"]
    broken = Counter[int]()
    for seed in seeds:
        world = world_faults.FaultyWorld("hold-breaks").draw(seed, plan)
        ((name, change),) = world.holds.items()
        hold = [hold.name for hold in plan.holds].index(name)
        assert hold in gripped(plan, change.breaks_at_s - START_S)
        broken[hold] += 1
    assert len(broken) >= 4


def test_a_kind_of_fault_has_walls_of_both_kinds() -> None:
    count = 2 * len(KINDS)
    jobs = world_faults.jobs_of(count, 1)
    assert [job.seed for job in jobs] == list(range(1, count + 1))
    for first, second in zip(jobs[: len(KINDS)], jobs[len(KINDS) :], strict=True):
        assert first.walls == second.walls
        assert {bool(first.wall.kind), bool(second.wall.kind)} == {False, True}
    some = world_faults.jobs_of(2, 1, ("hold-breaks",))
    assert some == [job for job in jobs if job.walls == "hold-breaks"], "alone it is climbed as among all"
    for job, fast in zip(
        some, world_faults.jobs_of(2, 1, ("hold-breaks",), worlds.Walls(objective="time")), strict=True
    ):
        assert parse_scenario(fast.wall.scenario()).planner.objective == "time"
        assert (fast.wall.planned(objective="paper"), fast.seed) == (job.wall.planned(objective="paper"), job.seed)


def test_kinds_of_the_world_are_no_faults_of_the_buses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for kind, world, said in (("cut", ["--world"], "a fault of the buses"), ("hold-breaks", [], "only with --world")):
        assert main(["bench", "faults", "--kinds", kind, *world, "--output", str(tmp_path)]) == 2
        assert f"--kinds {kind}: {said}" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["runtime-killed", pytest.param("disk-full", marks=pytest.mark.sweep)])
def test_a_runtime_killed_or_without_space_is_told_and_the_robot_stays(kind: str, plan: plan_t, tmp_path: Path) -> None:
    seed = list(KINDS).index(kind)
    job = job_of(draw_fault(seed), 0, seed)
    write_plan(tmp_path / PLAN_FILE, plan)
    climb = job._climb(plan, load_robot("scaler"), tmp_path)
    end = ending_of({"reason": climb["reason"], "climb": climb}, draw_fault(seed))
    assert (end.fell, end.told) == (False, True), climb
    assert end.climbed == (kind == "disk-full")
    (course,) = climb["faults"]
    if kind == "runtime-killed":
        assert climb["cycles"] == round(course["at_s"] / 0.002) + 1
        assert 0.0 < course["held_s"] <= 0.1, "the nodes hold by themselves"
        assert course["moved_m"] < 0.005
    assert job.climb_command().endswith("--faults faults.yaml --bus udp")


def test_a_runtime_that_restarts_has_to_climb_on() -> None:
    fault = Fault(RESTARTS, "")
    end = row(reason="34 restarted; the runtime has restarted: found hanging; goes on with the plan")
    assert not ending_of(end, fault).told
    end["climb"] |= {"reached_goal": True}
    assert ending_of(end, fault).told
    assert ending_of(end, fault).climbed
    assert not ending_of(end | {"reason": "35 restart_refused"}, fault).told


@pytest.mark.sweep
def test_a_runtime_restarts_in_a_drawn_climb(planned: SharedPlans, tmp_path: Path) -> None:
    short = planned(with_a_spare_hold(), load_robot("scaler")).plan
    seed = list(KINDS).index(RESTARTS)
    job = job_of(draw_fault(seed), 0, seed)
    climb = job._climb(short, load_robot("scaler"), tmp_path)
    end = ending_of({"reason": climb["reason"], "climb": climb}, draw_fault(seed))
    assert (end.told, end.climbed, end.fell) == (True, True, False), climb
    assert job.climb_command().endswith(f"--kinds runtime-restarts --count 1 --seed {seed} --output again")


def test_what_stops_the_runtime_is_climbed_in_a_kernel_with_virtual_time() -> None:
    for kind, options in (
        ("runtime-stopped", "--bus socketcan --pace realtime"),
        ("cpu-starved", "--bus socketcan --pace realtime"),
        ("lcm-flooded", "--bus udp --pace realtime"),
    ):
        command = job_of(Fault(kind, ""), 0, 7).climb_command()
        assert command.endswith(f"crux climb plan.mcap -o again.mcap --seed 7 --faults faults.yaml {options}")
        assert command.startswith("crux can run --virtual-time") == ("socketcan" in options)


def test_another_end_of_the_runtime_than_its_fault_is_not_told() -> None:
    late = "9.0 s: 26 cycle_late: a control cycle began 0.9 s late (limit: 0.01 s)"
    nodes_starved = "9.0 s: 30 all_nodes_silent: no valid status from any node, for 11 cycles (limit: 10)"
    nodes_late = "9.0 s: 31 all_nodes_hold: nodes of every limb hold by themselves"
    one_silent = "9.0 s: 1 node_silent, limb LF, node 1: no valid status from the node for 11 cycles (limit: 10)"
    for kind, reason, on_wall, told in (
        ("runtime-stopped", late, True, True),
        ("runtime-stopped", late, False, False),
        ("runtime-stopped", "9.0 s: 3 node_stopped, limb LF, node 1: it holds", True, False),
        ("runtime-stopped", nodes_starved, True, False),
        ("lcm-flooded", late, True, True),
        ("lcm-flooded", nodes_starved, True, True),
        ("lcm-flooded", nodes_late, True, True),
        ("lcm-flooded", one_silent, True, False),
        ("lcm-flooded", "9.0 s: 3 node_holds, limb LF, node 1: the node holds by itself", True, False),
    ):
        end = row(reason=reason)
        end["climb"]["robot_on_wall"] = on_wall
        assert ending_of(end, Fault(kind, "")).told == told


def test_walls_of_both_kinds_each_in_a_world_of_its_own() -> None:
    jobs = worlds.jobs_of(14, 5, WorldFile("ordinary", worlds.WORLD.read_text()))
    assert [job.seed for job in jobs] == list(range(5, 19))
    assert Counter(job.walls for job in jobs) == {"shipped scene": 7, "random wall": 7}
    assert len({job.wall for job in jobs}) == 7 + len(worlds.SCENES)
    assert len({job.key for job in jobs}) == 14


def test_the_ordinary_world_has_every_error_that_it_says() -> None:
    spec = read_world(worlds.WORLD)
    plan = standing_plan()
    first, again, other = (spec.draw(seed, plan) for seed in (1, 1, 2))
    assert first == again != other
    assert first.holds.keys() == {hold.name for hold in plan.holds}
    assert {(change.sensor, change.error) for change in first.sensors} == {
        ("encoder", "bias"),
        ("force_torque", "bias"),
        ("force_torque", "scale"),
    }
    assert len(first.pushes) == 2


@pytest.mark.parametrize(
    ("kind", "reason", "told"),
    [
        ("ft-zero", "12.0 s: 20 ft_implausible, limb RF, node 7: the joints' torques do not fit", True),
        ("ft-zero", "12.0 s: 20 ft_implausible, limb LF, node 7: the joints' torques do not fit", False),
        ("ft-zero", "the body ended 14.0 mm off the goal", False),
        ("hold-breaks", "9.1 s: 9 grip_lost, limb LF, node 7: finger force fell", True),
        ("hold-missing", "9.1 s: 29 hold_missing, limb LF, node 7: the fingers have closed", True),
        ("power-lost-limb", "9.1 s: 38 power_lost, limb RF: nodes had no power", True),
        ("power-lost-limb", "9.1 s: 38 power_lost, limb LF: nodes had no power", False),
        ("hold-missing", "9.1 s: 25 finger_force_implausible, limb LF, node 7: finger force is 23.8 N off", False),
    ],
)
def test_a_fault_is_told_where_its_cause_and_its_limb_are_named(kind: str, reason: str, told: bool) -> None:
    limb = "" if kind in LOSES_A_HOLD else "RF"
    end = row(reason=reason)
    end["climb"]["robot_on_wall"] = True
    assert ending_of(end, Fault(kind, limb)).told == told


def test_every_cause_is_a_fault_that_the_runtime_knows() -> None:
    causes = {cause for fault in IN_THE_WORLD.values() for cause in fault.causes}
    assert causes <= {fault.name for fault in FAULT_BY_CODE.values()}


def test_a_fall_is_what_the_judge_calls_one_and_a_lost_grip_counts_where_the_fault_is_about_no_hold() -> None:
    lost, thrown = row(body_m=0.0158, lost=("RF",)), row(fell=True, body_m=0.2, lost=("RF",))
    for kind, counts in (("hold-breaks", False), ("ft-zero", True)):
        ends = [ending_of(end, Fault(kind, "" if kind in LOSES_A_HOLD else "RF")) for end in (lost, thrown)]
        assert [end.fell for end in ends] == [False, True]
        assert [end.lost_grip for end in ends] == [counts, counts]
    assert (worlds.fell(lost), worlds.lost_grip(lost)) == (False, True)
    ends = [ending_of(lost, Fault("hold-breaks", ""))]
    for grips_left in (3, 2):
        thrown["climb"]["grips_left"] = grips_left
        ends.append(ending_of(thrown, Fault("hold-breaks", "")))
    line = world_faults.line_of(ends)
    few = line.pop("few_grips")
    assert line == {"climbs": 3, "at_goal": 0, "told": 0, "lost_grips": 0, "fell": 2, "most_body_m": 0.2}
    assert few == {"climbs": 1, "at_goal": 0, "told": 0, "lost_grips": 0, "fell": 1, "most_body_m": 0.2}


@pytest.mark.usefixtures("briefly_watched")
def test_grips_are_counted_in_physics_as_a_hold_breaks(plan: plan_t, tmp_path: Path) -> None:
    """LF is in the air 9 s after power-on."""
    for at_s, grips_left in ((4.5, 3), (9.5, 2)):
        text = f"version: 1\nname: x\nholds: {{1: {{breaks_at_s: {at_s}}}}}\n"
        job = world_faults.WorldFaultJob("hold-breaks", worlds.USUAL.of(0, 0), 0, WorldFile("x", text))
        assert job._climb(plan, load_robot("scaler"), tmp_path)["grips_left"] == grips_left


@pytest.mark.parametrize("scene", ["climb-makers", "climb-four-holds"])  # the latter with tolerances at its goal
def test_walls_like_a_given_one_have_its_robot_and_holds_that_are_scattered(scene: str) -> None:
    path = SCENARIOS / f"{scene}.yaml"
    given, walls = yaml.safe_load(path.read_text(encoding="utf-8")), worlds.Walls(path, "time")
    drawn = [yaml.safe_load(walls.of(0, seed).scenario()) for seed in (1, 1, 2)]
    assert drawn[0] == drawn[1] != drawn[2]
    assert drawn[0]["robot"] == given["robot"]
    assert drawn[0]["planner"]["objective"] == "time"
    for wall in drawn:
        for hold, old in zip(wall["holds"], given["holds"], strict=True):
            off_m = np.subtract(hold["position_m"], old["position_m"])
            assert 0.0 < np.abs(off_m).max() <= SCATTER_M
            assert 0.0 < abs(hold["yaw_deg"] - old.get("yaw_deg", 0.0)) <= YAW_DEG
            assert hold["size_m"] == old["size_m"]
    restart = job_of(Fault(RESTARTS, ""), 0, 7, walls).climb_command()
    assert f"--like {path.resolve()} --objective time" in restart


def test_walls_like_none_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = tmp_path / "none.yaml"
    assert main(["bench", "worlds", "--like", str(missing), "--output", str(tmp_path / "out")]) == 2
    assert str(missing) in capsys.readouterr().err


def test_causes_are_counted_without_their_numbers() -> None:
    stopped = row(
        reason="the runtime stopped climbing; 75.2 s: 8 tracking_error, limb LF, node 4: a joint is 0.3 rad off"
    )
    assert worlds.cause_of(stopped) == "failed: 8 tracking_error"
    assert worlds.cause_of(row(reason="the body ended 14.0 mm off", fell=True)) == "failed, fell: no fault told"
    assert (
        worlds.cause_of(row(reason="the body ended 14.0 mm off", lost=("RF",))) == "failed, lost a grip: no fault told"
    )
    assert worlds.cause_of(row(verdict="no plan", reason="no hold; more")) == "no plan: no hold"
