"""World files: what they may say, what they draw, and what a drawn one says again."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from crux_simulation.sim.world import (
    ERRORS,
    SENSORS,
    SHARES,
    GripperChange,
    HoldChange,
    JointChange,
    Payload,
    Push,
    World,
    WorldError,
)
from crux_simulation.sim.world_file import DISTRIBUTIONS, parse_world, read_world
from crux_tools.paths import ROOT
from hand_plan import climbing_plan
from scipy import stats

PLAN = climbing_plan()
HEAD = "version: 1\nname: test\n"
EVERYTHING = """version: 1
name: everything
holds:
  all: {offset_m: {normal: [0, 0.005]}, yaw_deg: {uniform: [-3, 3]}, friction_factor: {uniform: [0.6, 1]}}
  h1: {friction: {+x: 0.4, top: {uniform: [0, 1]}}, spines: {-x: false}, breaks_at_N: 40, size_change_m: [0.01, 0, 0]}
  2: {friction: {uniform: [0, 0.5]}, spines: false, present: false}
  h3: {breaks_at_s: {normal: [10, 1]}, corner_cut_m: [0.01, -0.02]}
robot:
  payload: {mass_kg: {uniform: [0, 1]}, position_m: [0, 0.08, {uniform: [0, 0.1]}]}
  ambient_degC: 30
  joints:
    all: {backlash_rad: {uniform: [0, 0.01]}, friction_Nm: 0.1, stiction_Nm: 0.2, lag_s: 0.001}
    LF: {torque_factor: 0.9, dead_cycles: 1, stiffness_Nm_rad: 2000, setpoint_time_constant_s: 0.03}
    LF.2: {torque_factor: 0.5, torque_limit_Nm: 3, heating_K_Nm2: 2, heating_time_s: 10}
  grippers:
    RR: {force_factor: 0.9, force_limit_N: 30, speed_limit_m_s: 0.01, jams_at_m: 0.04, jams_at_s: 9}
sensors:
  - {sensor: encoder, on: all, error: bias, rad: {uniform: [-0.01, 0.01]}}
  - {sensor: encoder, on: LF.3, error: jump, rad: 0.1, from_s: 10}
  - {sensor: force_torque, on: LF, error: drift, N: [0, 0, {uniform: [0, 1]}], Nm: {uniform: [0, 0.1]}, for_s: 9}
  - {sensor: force_torque, on: all, error: scale, factor: {uniform: [0.9, 1.1]}}
  - {sensor: force_torque, on: RF, error: cross_talk, share: 0.02}
  - {sensor: force_torque, on: RF, error: saturation, N: [50, 50, 50]}
  - {sensor: force_torque, on: RF, error: freeze, from_s: {uniform: [5, 9]}, for_s: 2}
  - {sensor: finger_opening, on: RR, error: zero, from_s: 4}
  - {sensor: finger_force, on: RR, error: nan, from_s: 5}
  - {sensor: finger_force, on: LR, error: dropout, share: 0.5}
pushes:
  - {at_s: {uniform: [5, 9]}, for_s: 0.2, force_N: {normal: [0, 10]}, moment_Nm: [0, 0, 1]}
"""


def drawn(text: str, seed: int = 0) -> World:
    return parse_world(text.encode()).draw(seed, PLAN)


@pytest.mark.parametrize("seed", [0, 7])
def test_a_drawn_world_written_and_read_is_the_same_world(seed: int) -> None:
    world = drawn(EVERYTHING, seed)
    for word in DISTRIBUTIONS:
        assert word not in world.as_yaml()
    again = parse_world(world.as_yaml().encode()).draw(seed + 1, PLAN)
    assert again.as_dict() == world.as_dict()
    assert (again.holds, again.joints, again.grippers, again.sensors, again.pushes, again.payload) == (
        world.holds, world.joints, world.grippers, world.sensors, world.pushes, world.payload
    )  # fmt: skip


def test_the_same_seed_draws_the_same_and_another_seed_draws_anew() -> None:
    assert drawn(EVERYTHING, 3) == drawn(EVERYTHING, 3)
    assert drawn(EVERYTHING, 3).holds["h4"] != drawn(EVERYTHING, 4).holds["h4"]


def test_a_draw_hangs_on_its_own_place_alone() -> None:
    """What else a file says does not change it, nor does the order."""
    few = drawn(HEAD + "holds:\n  h5: {yaw_deg: {uniform: [-3, 3]}}\n")
    assert few.holds["h5"].yaw_deg == drawn(EVERYTHING).holds["h5"].yaw_deg


def test_numbers_are_drawn_from_the_distributions_that_the_file_names() -> None:
    text = HEAD + "holds:\n  all: {offset_m: {normal: [0.002, 0.005]}, friction_factor: {uniform: [0.6, 1]}}\n"
    worlds = [drawn(text, seed) for seed in range(100)]
    holds = [hold for world in worlds for hold in world.holds.values()]
    offsets = np.array([hold.offset_m for hold in holds])
    assert offsets.shape == (800, 3)
    assert stats.kstest(offsets.ravel(), stats.norm(0.002, 0.005).cdf).pvalue > 1e-3
    assert np.abs(np.corrcoef(offsets.T) - np.eye(3)).max() < 0.15  # each component has a draw of its own
    factors = [hold.friction_factor for hold in holds]
    assert stats.kstest(factors, stats.uniform(0.6, 0.4).cdf).pvalue > 1e-3


def test_the_last_word_is_the_most_particular_one() -> None:
    world = drawn(EVERYTHING)
    assert world.joints["LF.2"].torque_factor == 0.5
    assert world.joints["LF.3"].torque_factor == 0.9
    assert world.joints["RF.3"].torque_factor == 1.0
    assert world.joints["LF.2"].friction_Nm == 0.1
    assert not world.holds["h2"].present  # named by its number
    assert len(set(world.holds["h2"].friction.values())) == 1
    assert world.holds["h1"].friction.keys() == {"+x", "top"}


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("version: 2\nname: x\n", 1, "version: 2: expected a whole number in 1..1"),
        (HEAD + "hold: {}\n", 3, "hold: unknown key; did you mean holds?"),
        (HEAD + "holds:\n  h1: {offset: [0, 0, 0]}\n", 4, "holds.h1.offset: unknown key; did you mean offset_m?"),
        (HEAD + "holds:\n  h1: {offset_m: [10, 0, 0]}\n", 4, "holds.h1.offset_m[0]: 10: expected a number in -1..1 m"),
        (HEAD + "holds:\n  h1: {offset_m: 3}\n", 4, "holds.h1.offset_m: 3: expected a list of 3 numbers in m"),
        (HEAD + "holds:\n  h1: {yaw_deg: {normale: [0, 1]}}\n", 4, "or {normal: [mean, deviation]}"),
        (HEAD + "holds:\n  h1: {yaw_deg: {normal: [0, -1]}}\n", 4, "holds.h1.yaw_deg.normal[1]: -1: expected"),
        (HEAD + "holds:\n  h1: {yaw_deg: {uniform: [3, 1]}}\n", 4, "uniform[1]: 1: expected a number in 3..180"),
        (HEAD + "holds:\n  h1: {yaw_deg: {uniform: 3}}\n", 4, "expected [least, most]"),
        (HEAD + "holds:\n  h1: {present: maybe}\n", 4, "expected true or false"),
        (HEAD + "holds:\n  h1: {friction: {left: 1}}\n", 4, "friction.left: unknown key"),
        (HEAD + "holds:\n  h9: {present: false}\n", 4, "holds.h9: no such hold in the plan; expected h0, h1"),
        (HEAD + "robot:\n  joints:\n    LF.8: {lag_s: 0}\n", 5, "robot.joints.LF.8: unknown key"),
        (HEAD + "robot:\n  joints:\n    LF.1: {backlash_rad: 10}\n", 5, "expected a number in 0..0.2 rad"),
        (HEAD + "sensors:\n  - {sensor: encoder, on: LF, error: bias}\n", 4, "bias of encoder needs rad"),
        (
            HEAD + "sensors:\n  - {sensor: encoder, on: LF, error: bias, rad: 0, N: 1}\n",
            4,
            "does not go with bias of encoder",
        ),
        (HEAD + "sensors:\n  - {sensor: finger_force, on: RR, error: bias, N: 1e9}\n", 4, "in -1000..1000 N"),
        (HEAD + "sensors:\n  - {sensor: gyro, on: LF, error: zero}\n", 4, "expected force_torque, encoder"),
        (
            HEAD + "sensors:\n  - {sensor: encodr, on: LF, error: bias, rad: 0.1}\n",
            4,
            '"encodr": expected force_torque',
        ),
        (HEAD + "sensors:\n  - {sensor: encoder, on: LF, error: bais, rad: 0.1}\n", 4, '"bais": expected'),
        (HEAD + "sensors:\n  - {sensor: force_torque, on: LF.1, error: zero}\n", 4, 'on: "LF.1": expected all, LF'),
        (HEAD + "sensors:\n  - {sensor: encoder, on: LF, error: jump, rad: 0.1}\n", 4, "the time of it: from_s"),
        (
            HEAD + "pushes:\n  - {at_s: 1, for_s: 1, force_N: [1, 0, 0]}\n",
            4,
            "pushes[0].at_s: 1: expected a number in 2",
        ),
        (HEAD + "pushes:\n  - {at_s: 5}\n", 4, "for_s"),
        (HEAD + "pushes: {}\n", 3, "expected a list"),
        (HEAD + "holds: 3\n", 3, "expected a mapping"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, text: str, line: int, said: str) -> None:
    path = tmp_path / "world.yaml"
    path.write_text(text)
    with pytest.raises(WorldError) as error:
        read_world(path).draw(0, PLAN)
    assert str(error.value).startswith(f"{path}:{line}: ")
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_the_example_has_every_key_and_is_read() -> None:
    path = ROOT / "examples" / "world.yaml"
    text = path.read_text(encoding="utf-8")
    read_world(path).draw(0, PLAN)  # which refuses keys that there are not
    kinds = (HoldChange, JointChange, GripperChange, Payload, Push)
    keys = {key.name for kind in kinds for key in fields(kind)} | {*DISTRIBUTIONS, "ambient_degC", "for_s"}
    keys |= {unit for channels in SENSORS.values() for unit in channels} | {key for key, _ in SHARES.values()}
    assert keys <= set(re.findall(r"[\w-]+(?=: )|(?<=\{)[\w-]+(?=:)", text))
    assert {*ERRORS} == set(re.findall(r"error: (\w+)", text))
    assert {*SENSORS} == set(re.findall(r"[{]sensor: (\w+)", text))


def test_the_worlds_that_ship_are_worlds_and_say_what_they_do() -> None:
    paths = sorted((ROOT / "tools" / "worlds").glob("*.yaml"))
    assert "ordinary" in {path.stem for path in paths}
    for path in paths:
        assert read_world(path).name == path.stem
        assert re.match(r"# [A-Z][^\n]+", path.read_text(encoding="utf-8")), f"{path.name} begins with no sentence"
