"""The systemd unit names options that the runtime has, and gives it what its real-time thread asks for."""

from __future__ import annotations

import os
import re
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


def ended_with(*words: str) -> tuple[int, str]:
    ended = subprocess.run([RUNTIME, *words], capture_output=True, text=True, check=False)
    return ended.returncode, ended.stderr


def test_a_runtime_that_could_not_start_is_started_anew_after_a_while() -> None:
    """Whatever kept it from its robot may be over by then; only an orderly end is one."""
    for words, reason in ((["--insecure", "--robot", "/nowhere"], "/nowhere"), ([], "crux key new")):
        status, said = ended_with(*words)
        assert reason in said
        assert status == 2
    assert value("Restart") == "on-failure"
    assert value("RestartPreventExitStatus").split() == ["1"]
    assert value("StartLimitIntervalSec") == "0", "for ever"
    (delay,) = re.findall(r"sleep (\d+)", value("ExecStopPost"))
    assert 0 < int(delay) < int(value("TimeoutStopSec"))
    command = re.fullmatch(r"/bin/sh -c '(.*)'", value("ExecStopPost"))
    assert command is not None
    for ended, sleeps in (("2", True), ("1", False), ("KILL", False), ("", False)):
        shell = ["sh", "-c", f"sleep() {{ echo sleeps $1; }}; {command[1]}"]
        done = subprocess.run(shell, env={"EXIT_STATUS": ended}, capture_output=True, text=True, check=True)
        assert done.stdout == (f"sleeps {delay}\n" if sleeps else "")


def test_the_service_has_a_user_of_its_own_and_no_way_out() -> None:
    """By systemd's own measure: 0 is best, 10 worst."""
    unit = ROOT / "packaging" / "crux-runtime.service"
    words = ["systemd-analyze", "security", "--offline=true", "--threshold=30", str(unit)]
    judged = subprocess.run(words, capture_output=True, text=True, check=False)
    assert judged.returncode == 0, judged.stdout
    assert value("CapabilityBoundingSet") == ""
    assert value("RuntimeDirectoryMode") == "0700", "its locks are its own"
    rule = (ROOT / "packaging" / "crux-runtime.rules").read_text(encoding="utf-8")
    assert f'GROUP="{value("User")}"' in rule
    assert re.findall(r'KERNEL=="(.*?)"', rule) == [value("DeviceAllow").split()[0].removeprefix("/dev/")]
    source = (ROOT / "runtime" / "app" / "realtime.cpp").read_text(encoding="utf-8")
    assert f'"{value("DeviceAllow").split()[0]}"' in source


def test_buses_may_have_the_receive_buffers_that_they_ask_for() -> None:
    (most,) = re.findall(r"^net.core.rmem_max = (\d+)$", packaged("sysctl"), re.MULTILINE)
    source = (ROOT / "runtime" / "bus" / "bus.cpp").read_text(encoding="utf-8")
    ((factor, shift),) = re.findall(r"kReceiveBufferBytes = (\d+) << (\d+)", source)
    assert int(factor) << int(shift) <= int(most)


def packaged(kind: str) -> str:
    return (ROOT / "packaging" / f"crux-runtime.{kind}").read_text(encoding="utf-8")


def test_logs_belong_to_the_service_and_go_after_90_days(tmp_path: Path) -> None:
    for kind in ("sysusers", "tmpfiles"):
        rule = tmp_path / "usr" / "lib" / f"{kind}.d" / "crux-runtime.conf"
        rule.parent.mkdir(parents=True)
        rule.write_text(packaged(kind), encoding="utf-8")
    (tmp_path / "etc").mkdir()
    subprocess.run(["systemd-sysusers", f"--root={tmp_path}"], check=True)
    assert re.search(rf"^{value('User')}:", (tmp_path / "etc" / "passwd").read_text(), re.MULTILINE)
    logs = tmp_path / "var" / "log" / value("LogsDirectory")
    logs.mkdir(parents=True)
    for days in (1, 89, 91):
        (logs / f"{days}.mcap").touch()
        os.utime(logs / f"{days}.mcap", (time.time(), time.time() - days * 86400))
    subprocess.run(["systemd-tmpfiles", "--clean", f"--root={tmp_path}"], check=True)
    assert {path.stem for path in logs.iterdir()} == {"1", "89"}
