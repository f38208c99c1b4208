"""`crux bench worlds` and `crux bench faults --world`: what is drawn, and what counts as a fall, told, at the goal."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from crux_contracts import LIMB_NAMES
from crux_tools.benchmarks import world_faults, worlds
from crux_tools.benchmarks.world_faults import KINDS, Fault, draw_fault, ending_of
from crux_tools.campaign.job import WorldFile
from crux_tools.sim.world_file import read_world
from hand_plan import standing_plan


def row(verdict: str = "failed", reason: str = "", fell: bool = False, body_m: float = 0.002) -> dict[str, Any]:
    return {"verdict": verdict, "reason": reason, "climb": {"fell": fell, "tracking": {"body_m": body_m}}}


def test_every_kind_of_fault_comes_by_turns_as_a_world_that_can_be_read(tmp_path: Path) -> None:
    faults = [draw_fault(seed) for seed in range(60)]
    assert Counter(fault.kind for fault in faults) == dict.fromkeys(KINDS, 60 // len(KINDS))
    for number, fault in enumerate(faults):
        path = tmp_path / f"{number}.yaml"
        path.write_text(fault.text)
        assert read_world(path).name == fault.kind
        assert fault.limb == "" or fault.limb in LIMB_NAMES
    assert [draw_fault(seed) for seed in range(60)] == faults
    assert len({fault.text for fault in faults}) > 50


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
    ],
)
def test_a_fault_is_told_where_its_limb_is_named(kind: str, reason: str, told: bool) -> None:
    limb = "" if kind in world_faults.WITHOUT_A_LIMB else "RF"
    assert ending_of(row(reason=reason), Fault(kind, limb, "")).told == told


def test_a_limb_off_its_hold_has_not_fallen_where_the_body_stays() -> None:
    lost, thrown = row(fell=True, body_m=0.004), row(fell=True, body_m=0.2)
    assert [ending_of(end, Fault("hold-breaks", "", "")).fell for end in (lost, thrown)] == [False, True]
    assert ending_of(lost, Fault("ft-zero", "RF", "")).fell


def test_causes_are_counted_without_their_numbers() -> None:
    stopped = row(
        reason="the runtime stopped climbing; 75.2 s: 8 tracking_error, limb LF, node 4: a joint is 0.3 rad off"
    )
    assert worlds.cause_of(stopped) == "failed: 8 tracking_error"
    assert worlds.cause_of(row(reason="the body ended 14.0 mm off", fell=True)) == "failed, fell: no fault told"
    assert worlds.cause_of(row(verdict="no plan", reason="no hold; more")) == "no plan: no hold"
