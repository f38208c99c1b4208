"""What the report says of causes: planted into the made-up climb, one at a time, and found by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.channels import FAULT_BY_CODE
from crux_msgs.tables import FAULT_HELP
from crux_tools.report import figures
from crux_tools.report.causes import cause_sections
from crux_tools.report.command import write_report
from crux_tools.report.evidence import evidence, moment_of, stories
from crux_tools.telemetry import Telemetry, read_channels, read_log
from crux_tools.telemetry.summary import FaultNote, summarise
from crux_tools.view.recording import blank, recording_of_log
from made_up_climb import CYCLE_S
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

ROW = 300  # where the fault is, of a log that begins with cycle 0
RF, JOINTS = 1, 6
JOINT_5 = RF * JOINTS + 4


def _note(time_s: float, code: int = 1, limb: str | None = "RF", node: int = 0) -> FaultNote:
    kind = FAULT_BY_CODE[code]
    return FaultNote(time_s, code, kind.name, limb, node, 0.0, 0.0, kind.text)


@pytest.fixture
def log(log_path: Path) -> Telemetry:
    """As a robot's: sensors that never say the same twice, commands that move."""
    read = read_log(log_path)
    noise = np.random.default_rng(0)
    inputs, outputs, limbs = read.inputs.copy(), read.outputs.copy(), read.limbs.copy()
    for name in ("joint_position_rad", "ft_force_g_n", "finger_force_n"):
        inputs[name] += noise.normal(0, 1e-5, inputs[name].shape)
    outputs["joint_position_rad"] += 0.01 * np.arange(len(outputs))[:, None]
    return replace(read, inputs=inputs, outputs=outputs, limbs=limbs)


def _evidence(log: Telemetry) -> list[str]:
    return evidence(moment_of(log, _note(float(log.time_s[ROW]))))


def test_a_climb_as_it_should_be_shows_nothing(log: Telemetry) -> None:
    assert [words for words in _evidence(log) if "waited" not in words] == []


def _cut_bus(log: Telemetry) -> None:
    log.inputs["joint_fresh"][ROW - 10 :, RF * JOINTS : (RF + 1) * JOINTS] = 0
    log.inputs["gripper_fresh"][ROW - 10 :, RF] = 0


def _dead_node(log: Telemetry) -> None:
    log.inputs["joint_fresh"][ROW - 10 :, JOINT_5] = 0


def _deaf_computer(log: Telemetry) -> None:
    log.inputs["joint_fresh"][ROW - 10 :] = 0
    log.inputs["gripper_fresh"][ROW - 10 :] = 0


def _lossy_bus(log: Telemetry) -> None:
    log.inputs["joint_fresh"][ROW - 99 : ROW + 1 : 2, RF * JOINTS : (RF + 1) * JOINTS] = 0


def _frozen_encoder(log: Telemetry) -> None:
    log.inputs["joint_position_rad"][ROW - 40 :, JOINT_5] = 0.5


def _frozen_sensor(log: Telemetry) -> None:
    log.inputs["ft_force_g_n"][ROW - 40 :, 3 * RF : 3 * RF + 3] = 1.0


def _hot_node(log: Telemetry) -> None:
    log.inputs["joint_state"][ROW - 5 :, JOINT_5] = 4
    log.inputs["joint_faults"][ROW - 5 :, JOINT_5] = 1 << 5


def _slick_hold(log: Telemetry) -> None:
    log.limbs["slip_m"][ROW - 20 :, RF] = 0.0042
    log.limbs["slip_friction"][ROW - 20 :, RF] = 0.31


def _loose_grasp(log: Telemetry) -> None:
    log.limbs["stance_shift_g_m"][ROW - 20 :, RF] = (0.0, 0.003, 0.004)


def _bus_off(log: Telemetry) -> None:
    log.inputs["bus_state"][ROW - 2 :, RF] = 3


def _since(rows: int) -> str:
    return f"since {(ROW - rows) * CYCLE_S:.3f} s"


@pytest.mark.parametrize(
    ("plant", "words"),
    [
        (_cut_bus, ("All 7 nodes of RF are silent", _since(10), "bus of that limb is cut")),
        (_dead_node, ("RF joint 5 silent", _since(10), "the other nodes of that bus are heard")),
        (_deaf_computer, ("No node of any limb was heard", _since(10))),
        (_lossy_bus, ("42 % of the answers of RF's nodes",)),
        (_frozen_encoder, ("encoder of RF joint 5", "0.50000 rad", _since(40), "400.0 mrad")),
        (_frozen_sensor, ("force/torque sensor of RF", _since(40))),
        (_hot_node, ("RF joint 5 is in FAULT", _since(5), "OVER_TEMPERATURE")),
        (_slick_hold, ("RF slid by 4.2 mm on b at friction 0.31", "counts on 2.20: the hold is smoother")),
        (_loose_grasp, ("RF moved by 5.0 mm on b against the other grips", "pressed with 30 N")),
        (_bus_off, ("The CAN controller of RF says", _since(2))),
    ],
)
def test_a_planted_cause_is_named_first(
    plant: Callable[[Telemetry], None], words: tuple[str, ...], log: Telemetry
) -> None:
    plant(log)
    first = _evidence(log)[0]
    assert all(word in first for word in words), first


@pytest.mark.parametrize(("compute_ns", "why"), [(90_000, "the computer gave it no time"), (30_000_000, "that is why")])
def test_a_late_cycle_tells_whose_time_it_was(compute_ns: int, why: str, log: Telemetry) -> None:
    log.inputs["late_s"][ROW] = 0.0123
    timing = log.timing.copy()
    timing["compute_ns"][ROW - 1] = compute_ns
    in_real_time = replace(log, timing=timing, metadata={**log.metadata, "pace": "clock"})
    first = _evidence(in_real_time)[0]
    assert f"cycle at {ROW * CYCLE_S:.3f} s began 12.3 ms late" in first
    assert first.endswith(f"{why}.")
    assert all("late" not in words for words in _evidence(log))  # in lockstep there is no clock


def test_the_viewer_tells_it_with_the_fault(log: Telemetry, log_path: Path) -> None:
    _cut_bus(log)
    faults = blank("/fault", 1)
    faults["cycle"], faults["code"], faults["limb"] = log.state["cycle"][ROW], 1, RF
    recording = recording_of_log(replace(log, faults=faults), read_channels(log_path))
    assert recording is not None
    at = [event.text for event in recording.events if event.log_ns == round(log.time_s[ROW] * 1e9)]
    assert at[0].startswith("fault 1 node_silent, limb RF")
    assert at[1].startswith("the log shows: All 7 nodes of RF are silent")


def test_nothing_is_made_of_a_log_that_has_only_some_cycles(log: Telemetry) -> None:
    _cut_bus(log)
    log.inputs["cycle"] *= 25
    assert _evidence(log) == []


def test_what_follows_within_a_second_belongs_to_the_first() -> None:
    told = stories([_note(5.2), _note(1.0), _note(1.9), _note(2.8), _note(4.0)])
    assert [[note.time_s for note in story] for story in told] == [[1.0, 1.9, 2.8], [4.0], [5.2]]


def test_a_section_says_what_usually_is_behind_a_fault_and_what_to_do(
    faulty_log_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[list[str]] = []

    def labels(figure: Figure) -> bytes:
        drawn.append([axis.get_ylabel() for axis in figure.axes])
        plt.close(figure)
        return b"PNG"

    monkeypatch.setattr(figures, "png", labels)
    log = read_log(faulty_log_path)
    (section,) = cause_sections(log, summarise(log))
    assert section.title == "Cause: body_error, 2.00 s"
    told = dict(section.rows)
    assert (told["what usually is behind it"], told["what to do"]) == FAULT_HELP[7]
    assert told["look at it"] == "crux view faulty.mcap --at 1.000"
    assert section.plots == [b"PNG"]
    assert [label.partition("\n")[0] for label in drawn[0]] == [
        "joints off", "finger force [N]", "force off", "answers", "cycle [ms]",
    ]  # fmt: skip


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_a_fault_in_the_first_cycle_has_a_page(log_path: Path, tmp_path: Path) -> None:
    log = read_log(log_path)
    faults = blank("/fault", 2)
    faults["code"], faults["limb"] = [1, 99], [2, -1]
    sections = cause_sections(log, summarise(replace(log, faults=faults)))
    assert [section.title for section in sections] == ["Cause: node_silent of LR, 0.00 s"]
    write_report(log_path, tmp_path / "page.html")
    assert 'id="cause' not in (tmp_path / "page.html").read_text(encoding="utf-8")
