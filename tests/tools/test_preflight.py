"""`crux preflight`: what it finds on machines made up in a folder, and on this one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs import status_t
from crux_tools.preflight.joints import joints
from crux_tools.preflight.latency import histogram, lateness
from crux_tools.preflight.machine import BAD, DOUBTFUL, GOOD, Kernel, disk, of_machine, sleep

PERIOD_S = 0.002
FIT = {
    "sys/kernel/realtime": "1",
    "sys/devices/system/cpu/isolated": "3",
    "sys/devices/system/cpu/cpu0/cpufreq/scaling_governor": "performance",
    "proc/sys/kernel/sched_rt_runtime_us": "950000",
    "proc/sys/kernel/sched_rt_period_us": "1000000",
    "sys/class/thermal/thermal_zone0/temp": "41000",
    "sys/class/thermal/thermal_zone1/temp": "52500",
}
UNFIT = [
    ("kernel", {"sys/kernel/realtime": "0", "proc/version": "Linux 6.1 #1 SMP PREEMPT_DYNAMIC"}, DOUBTFUL),
    ("isolation", {"sys/devices/system/cpu/isolated": ""}, DOUBTFUL),
    ("frequency", {"sys/devices/system/cpu/cpu7/cpufreq/scaling_governor": "powersave"}, DOUBTFUL),
    ("throttling", {"proc/sys/kernel/sched_rt_runtime_us": "100000"}, BAD),
    ("heat", {"sys/class/thermal/thermal_zone1/temp": "91000"}, BAD),
]


def verdicts(folder: Path, files: dict[str, str]) -> dict[str, str]:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")
    return {finding.topic: finding.verdict for finding in of_machine(Kernel(folder), folder)}


def test_nothing_is_wrong_with_a_fit_kernel(tmp_path: Path) -> None:
    found = verdicts(tmp_path, FIT)
    assert {found[topic] for topic, _, _ in UNFIT} == {GOOD}


@pytest.mark.parametrize(("topic", "change", "verdict"), UNFIT)
def test_one_thing_is_wrong(topic: str, change: dict[str, str], verdict: str, tmp_path: Path) -> None:
    found = verdicts(tmp_path, FIT | change)
    assert [name for name, _, _ in UNFIT if found[name] != GOOD] == [topic]
    assert found[topic] == verdict


def test_a_kernel_that_tells_nothing_is_no_error(tmp_path: Path) -> None:
    assert verdicts(tmp_path, {})["kernel"] == DOUBTFUL


def test_processors_that_cannot_be_kept_awake_are_told(tmp_path: Path) -> None:
    device = tmp_path / "cpu_dma_latency"
    assert sleep(device).verdict == DOUBTFUL
    device.touch()
    assert sleep(device).verdict == GOOD
    assert "is missing" in sleep(tmp_path / "none").found


def test_logs_need_a_folder_that_can_be_written(tmp_path: Path) -> None:
    assert disk(tmp_path / "not" / "yet").verdict != BAD
    assert disk(Path("/proc")).verdict == BAD
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("late_s", "verdict"), [(-1.0, GOOD), (0.002, GOOD), (0.006, BAD)])
def test_drives_are_judged_by_what_the_gains_bear(late_s: float, verdict: str) -> None:
    status = status_t()
    status.state.cycle = 1
    status.joint_dead_time_s = [0.0] * 26 + [late_s, 0.0]
    finding = joints(load_robot("scaler"), status)
    assert finding.verdict == verdict
    assert finding.found.startswith("gains bear drives that answer 4.0 ms late; ")
    assert ("RR.6 answers" in finding.found) == (late_s > 0)
    assert joints(load_robot("scaler"), None).verdict == GOOD


@pytest.mark.parametrize(("worst_us", "often", "verdict"), [(90, 1, GOOD), (900, 1, DOUBTFUL), (900, 50, BAD)])
def test_lateness_is_judged_against_a_quarter_of_a_cycle(worst_us: float, often: int, verdict: str) -> None:
    late_us = np.full(10_000, 15.0)
    late_us[:often] = worst_us
    assert lateness(late_us, is_real_time=True, period_s=PERIOD_S).verdict == verdict
    assert dict(histogram(late_us))["10 to 20 µs"] == 10_000 - often


def test_this_machine(tmp_path: Path) -> None:
    """All the words at once, and one object for machines; whether it is fit is its own matter."""
    words = ["preflight", "--seconds", "0.2", "--no-can", "--logs", str(tmp_path), "--json"]
    words += ["--lcm", "udpm://239.255.76.67:7699?ttl=0"]
    run = subprocess.run(
        [sys.executable, "-m", "crux_tools.cli", *words], capture_output=True, text=True, timeout=600, check=False
    )
    result = json.loads(run.stdout)
    topics = [check["topic"] for check in result["checks"]]
    assert topics[-4:] == ["disk", "joints", "LCM", "lateness"]
    assert sum(result["woken_late"].values()) == 100
    assert run.returncode == (0 if result["ok"] else 1)
    assert all(check["remedy"] for check in result["checks"] if check["verdict"] == BAD)
    assert "Traceback" not in run.stderr
