"""The bench's cycle with made-up nodes: when it ends, what it repeats, what it does when the runtime dies."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_simulation.sim.loop import (
    CLIMBING,
    FAULT,
    FREE_RUN_S,
    HOLDING,
    PLAN_COMPLETE,
    READY,
    REST_CYCLES,
    START_CYCLE,
    START_GRACE_CYCLES,
    Ending,
    Loop,
    Outcome,
    WorldClock,
)
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.recorder import recorded
from crux_tools.robot3d.robot_model import build_model
from hand_plan import standing_plan
from holding_controller import HoldingController
from numpy.typing import NDArray

START = START_CYCLE + START_GRACE_CYCLES
LATE_S = 1e-6


class MadeUpNodes:
    """Plays a list of Syncs and host states; controls by the holding controller."""

    def __init__(self, plant: Plant, cycles: list[int | None], host: dict[int, int]) -> None:
        self._plant = plant
        self._controller = HoldingController(plant)
        self._cycles = iter(cycles)
        self._host = host
        self.cycle = 0
        self.published = 0
        self.controlled = 0

    def wait_sync(self, timeout_s: float) -> int | None:
        assert timeout_s > 0
        cycle = next(self._cycles, None)
        self.cycle = self.cycle if cycle is None else cycle
        return cycle

    def step(self, plant: Plant) -> None:
        assert plant is self._plant
        self.controlled += 1
        plant.step(*self.command())

    def command(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self._controller.command()

    def publish(self, plant: Plant) -> None:
        assert plant is self._plant
        self.published += 1

    def host_state(self) -> int:
        return self._host[max(since for since in self._host if since <= self.cycle)]


def run(nodes: MadeUpNodes, plant: Plant, max_cycles: int = 10**6, alive: bool = True) -> Outcome:
    return Loop(nodes, plant, lambda: alive, lambda _time_s: None, max_cycles).run()


class TimedNodes(MadeUpNodes):
    """Syncs come a period after each other; who waits in vain wakes up a little late; before `asleep` cycles the
    simulation itself sleeps for a second."""

    now_s = 0.0
    asleep: tuple[int, ...] = ()

    def wait_sync(self, timeout_s: float) -> int | None:
        cycle = super().wait_sync(timeout_s)
        self.now_s += timeout_s + LATE_S if cycle is None else self._plant.dt_s
        self.now_s += 1.0 if cycle in self.asleep else 0.0
        return cycle


def run_by_the_clock(nodes: TimedNodes, plant: Plant) -> Outcome:
    clock = WorldClock(plant.dt_s, lambda: nodes.now_s)
    return Loop(nodes, plant, lambda: True, lambda _time_s: None, 10**6, clock=clock).run()


@pytest.fixture
def plant() -> Plant:
    plan = standing_plan()
    return Plant(build_model(load_robot("scaler"), plan), plan, 0)


def test_ends_a_fixed_rest_after_the_plan_is_complete(plant: Plant) -> None:
    host = {0: READY, START_CYCLE: CLIMBING, 1300: HOLDING | PLAN_COMPLETE}
    nodes = MadeUpNodes(plant, list(range(5000)), host)
    outcome = run(nodes, plant)
    assert outcome.ending is Ending.COMPLETE
    assert outcome.cycles == 1300 + REST_CYCLES + 1
    assert plant.cycle == nodes.controlled == nodes.published == outcome.cycles


@pytest.mark.parametrize(
    ("host", "ending"),
    [(HOLDING, Ending.STOPPED), (FAULT, Ending.STOPPED), (READY, Ending.NOT_STARTED)],
)
def test_ends_when_the_runtime_does_not_climb(plant: Plant, host: int, ending: Ending) -> None:
    outcome = run(MadeUpNodes(plant, list(range(5000)), {0: host}), plant)
    assert outcome.ending is ending
    assert outcome.cycles == START + 1 + REST_CYCLES + 1


def test_ends_when_the_climb_takes_too_long(plant: Plant) -> None:
    outcome = run(MadeUpNodes(plant, list(range(5000)), {0: READY, START_CYCLE: CLIMBING}), plant, max_cycles=1500)
    assert outcome.ending is Ending.TIMEOUT
    assert outcome.cycles == 1500 + REST_CYCLES + 1


def test_a_repeated_first_sync_is_answered_without_moving_physics(plant: Plant) -> None:
    host = {0: READY, START_CYCLE: CLIMBING, 1200: HOLDING | PLAN_COMPLETE}
    nodes = MadeUpNodes(plant, [0, 0, None, 0, *range(1, 3000)], host)
    outcome = run(nodes, plant)
    assert plant.cycle == nodes.controlled == outcome.cycles
    assert nodes.published == outcome.cycles + 2


def test_syncs_the_bench_came_too_late_for_are_counted(plant: Plant) -> None:
    cycles = [0, 1, 2, 6, 7, *range(8, 3000)]
    nodes = MadeUpNodes(plant, cycles, {0: READY, START_CYCLE: CLIMBING, 1200: HOLDING | PLAN_COMPLETE})
    outcome = run(nodes, plant)
    assert outcome.missed == 3
    assert plant.cycle == outcome.cycles - 3


def test_after_the_runtimes_death_the_nodes_are_watched_on_their_own(plant: Plant) -> None:
    nodes = MadeUpNodes(plant, [*range(1500), None], {0: READY, START_CYCLE: CLIMBING})
    outcome = run(nodes, plant, alive=False)
    assert outcome.ending is Ending.RUNTIME_DIED
    assert outcome.cycles == 1500
    assert plant.cycle == 1500 + round(FREE_RUN_S / plant.dt_s)
    assert outcome.robot_on_wall is True


def test_a_runtime_that_hangs_is_not_waited_for_forever(plant: Plant, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("crux_simulation.sim.loop.SILENCE_S", 0.0)
    outcome = run(MadeUpNodes(plant, [*range(100), None], {0: READY}), plant)
    assert outcome.ending is Ending.SILENT
    assert outcome.cycles == 100


@pytest.mark.parametrize("grip_share", [0.0, 1.0])
def test_limp_joints_drop_the_robot_even_where_its_grippers_hold(plant: Plant, grip_share: float) -> None:
    class Failing(MadeUpNodes):
        def command(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            torque, force = super().command()
            return (torque * 0, force * grip_share) if plant.cycle > 1500 else (torque, force)

    outcome = run(Failing(plant, [*range(1500), None], {0: READY, START_CYCLE: CLIMBING}), plant, alive=False)
    assert outcome.robot_on_wall is False


STOPS = [*range(1501), *[None] * 100, *range(1501, 3000)]
TO_THE_END = {0: READY, START_CYCLE: CLIMBING, 1800: HOLDING | PLAN_COMPLETE}


def test_in_real_time_nodes_and_physics_go_on_while_no_sync_comes(plant: Plant) -> None:
    nodes = TimedNodes(plant, STOPS, TO_THE_END)
    outcome = run_by_the_clock(nodes, plant)
    assert outcome.ending is Ending.COMPLETE
    assert plant.cycle == nodes.controlled == nodes.published == outcome.cycles + 100
    assert plant.time_s == pytest.approx(nodes.now_s, abs=3 * plant.dt_s)
    truth = recorded(plant)
    stopped = truth.cycle == 1500
    assert np.count_nonzero(stopped) >= 20
    assert not truth.climbing[stopped].any(), "a runtime that is silent does not climb"
    assert truth.climbing[(truth.cycle > 1500) & (truth.cycle < 1800)].all()


def test_in_lockstep_they_wait_for_it(plant: Plant) -> None:
    nodes = MadeUpNodes(plant, STOPS, TO_THE_END)
    outcome = run(nodes, plant)
    assert plant.cycle == nodes.controlled == outcome.cycles == 1800 + REST_CYCLES + 1


def test_what_the_simulation_itself_sleeps_through_is_lost_and_not_made_good(plant: Plant) -> None:
    nodes = TimedNodes(plant, [*range(1501), *range(2000, 3000)], {**TO_THE_END, 1800: CLIMBING, 2200: PLAN_COMPLETE})
    nodes.asleep = (2000,)
    outcome = run_by_the_clock(nodes, plant)
    assert outcome.missed == 499
    assert plant.cycle == outcome.cycles - 499


def test_syncs_that_come_too_often_make_the_world_no_faster() -> None:
    now_s = 0.0
    clock = WorldClock(0.002, lambda: now_s)
    steps = 0
    for millisecond in range(1000):
        now_s = millisecond * 1e-3
        steps += clock.moves_on(heard=True)
    assert steps == pytest.approx(500, abs=2)
