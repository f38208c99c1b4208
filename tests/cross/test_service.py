"""The systemd unit names options that the runtime has, and gives it what its real-time thread asks for."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RUNTIME = ROOT / "build" / "cmake" / "runtime" / "app" / "crux-runtime"
UNIT = (ROOT / "packaging" / "crux-runtime.service").read_text(encoding="utf-8").replace("\\\n", "")


def value(key: str) -> str:
    (found,) = re.findall(rf"^{key}=(.*)$", UNIT, re.MULTILINE)
    return str(found)


def test_the_service_starts_the_runtime_with_options_that_it_has() -> None:
    described = subprocess.run([RUNTIME, "--help"], capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"--[a-z-]+", value("ExecStart"))) <= set(re.findall(r"--[a-z-]+", described))
    assert re.findall(r"--bus (\w+)=socketcan:can(\w+)", value("ExecStart")) == [
        (x, x) for x in ("LF", "RF", "LR", "RR")
    ]


def test_the_service_may_run_in_real_time() -> None:
    source = (ROOT / "runtime" / "app" / "realtime.cpp").read_text(encoding="utf-8")
    (priority,) = re.findall(r"kPriority = (\d+);", source)
    assert value("LimitRTPRIO") == priority
    assert value("LimitMEMLOCK") == "infinity"


def test_wrong_options_end_the_service_and_a_crash_does_not() -> None:
    """The status by which the runtime refuses its options is the one that is not tried again."""
    for words, reason in ((["--insecure", "--robot", "/nowhere"], "/nowhere"), ([], "crux key new")):
        refused = subprocess.run([RUNTIME, *words], capture_output=True, text=True, check=False)
        assert str(refused.returncode) == value("RestartPreventExitStatus")
        assert reason in refused.stderr
    assert value("Restart") == "on-failure"


def test_logs_go_after_90_days(tmp_path: Path) -> None:
    rule = Path("etc/tmpfiles.d/crux-runtime.conf")
    (tmp_path / rule).parent.mkdir(parents=True)
    shutil.copy(ROOT / "packaging" / "crux-runtime.tmpfiles", tmp_path / rule)
    logs = tmp_path / "var" / "log" / value("LogsDirectory")
    logs.mkdir(parents=True)
    for days in (1, 89, 91):
        (logs / f"{days}.mcap").touch()
        os.utime(logs / f"{days}.mcap", (time.time(), time.time() - days * 86400))
    subprocess.run(["systemd-tmpfiles", "--clean", f"--root={tmp_path}"], check=True)
    assert {path.stem for path in logs.iterdir()} == {"1", "89"}
