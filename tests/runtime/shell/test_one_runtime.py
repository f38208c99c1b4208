"""Doors that are shut: a second runtime beside the first one. Nobody but their owner can shut them."""

from __future__ import annotations

import socket
import subprocess
from contextlib import ExitStack
from pathlib import Path

import pytest
from crux_contracts import LIMB_NAMES
from crux_simulation.sim.ports import run_ports
from crux_tools.paths import built
from own_runtime import END_TIMEOUT_S, ROBOT, Runtime, Starter


@pytest.mark.parametrize("shared", ["lcm", "bus"])
def test_a_second_runtime_is_refused(start: Starter, shared: str) -> None:
    first: Runtime = start()
    with run_ports() as other:
        lcm_url = first.ports.lcm_url if shared == "lcm" else other.lcm_url
        buses = first.ports.bus_urls() if shared == "bus" else other.bus_urls()
        words = [word for name, url in zip(LIMB_NAMES, buses, strict=True) for word in ("--bus", f"{name}={url}")]
        command = [str(built("runtime/app/crux-runtime")), "--insecure", "--robot", str(ROBOT), "--lcm", lcm_url]
        command += words
        second = subprocess.run(command, capture_output=True, text=True, timeout=END_TIMEOUT_S, check=False)
    assert second.returncode == 2
    assert "another crux-runtime has it" in second.stderr
    assert (lcm_url if shared == "lcm" else buses[0]) in second.stderr


def test_what_a_killed_runtime_had_is_free(start: Starter) -> None:
    first = start()
    first.process.kill()
    first.process.wait()
    start(ports=first.ports)  # which waits for its answer


def test_names_in_the_network_namespace_which_anybody_may_take_lock_nobody_out(start: Starter) -> None:
    with run_ports() as ports, ExitStack() as taken:
        for address in (ports.lcm_url.partition("?")[0], *ports.bus_urls()):
            abstract = taken.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            abstract.bind(f"\0crux-runtime {address}")
        start(ports=ports)  # which waits for its answer


@pytest.mark.parametrize("kind", ["a file", "open to all", "a link", "full"])
def test_without_a_place_for_locks_it_starts_and_says_so(
    start: Starter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    (folder := tmp_path / "locks").mkdir(mode=0o700)
    if kind == "open to all":
        folder.chmod(0o777)
    elif kind == "full":  # stands for a disk without room: there, too, no lock file can be made
        folder = Path("/proc/self/task")
    elif kind == "a file":
        folder = tmp_path / "file"
        folder.write_text("")
    elif kind == "a link":
        (tmp_path / "link").symlink_to(folder)
        folder = tmp_path / "link"
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(folder))
    runtime = start()
    runtime.process.terminate()
    status, said = runtime.end()
    assert status == 0
    assert f"'{runtime.ports.lcm_url}' is not locked" in said


def test_locks_lie_where_only_the_user_writes(start: Starter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RUNTIME_DIRECTORY", raising=False)
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    start()
    (folder,) = tmp_path.glob("crux-*")
    assert folder.stat().st_mode & 0o777 == 0o700
    assert len(list(folder.glob("runtime-*.lock"))) == 1 + len(LIMB_NAMES)
