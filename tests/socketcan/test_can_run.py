"""`crux can run` passes everything through, ends what it started, and says what is wrong."""

from __future__ import annotations

import hashlib
import os
import shlex
import signal
import subprocess
import time
from pathlib import Path

import pytest
from crux_tools.cli import main
from with_can import CRUX, can_run

BYTES = bytes(range(256)) * 4000


def test_arguments_environment_folder_output_and_status_pass_through(tmp_path: Path) -> None:
    (tmp_path / "bytes").write_bytes(BYTES)
    script = 'printf "%s|" "$@" "$FOO" "$(pwd)"; cat bytes; seq 1 100000 >&2; echo written >there; exit 42'
    words = ("a b", "c'd", "$X", "")
    done = can_run("--", "sh", "-c", script, "sh", *words, cwd=tmp_path, env={**os.environ, "FOO": "x y\nz"})
    assert done.returncode == 42
    head = "".join(f"{word}|" for word in (*words, "x y\nz", str(tmp_path))).encode()
    assert done.stdout[: len(head)] == head
    assert hashlib.sha256(done.stdout[len(head) :]).digest() == hashlib.sha256(BYTES).digest()
    assert done.stderr == b"".join(b"%d\n" % i for i in range(1, 100001))
    assert (tmp_path / "there").read_text() == "written\n"


def test_signals_daemons_and_interfaces() -> None:
    script = "sleep 500 & ip -br link show type vcan; kill -SEGV $$"
    done = can_run("-i", "can0,canopen1", "--", "sh", "-c", script)
    assert done.returncode == 128 + signal.SIGSEGV
    assert [line.split()[0] for line in done.stdout.splitlines()] == [b"can0", b"canopen1"]


@pytest.mark.sweep
def test_the_hosts_own_socketcan_is_used_where_there_is_some() -> None:
    """A guest is such a host: inside it the same tool needs no kernel of ours."""
    script = "sleep 500 & ip -br link show type vcan; kill -SEGV $$"
    inner = [*CRUX, "can", "run", "-v", "-i", "can7", "--", "sh", "-c", script]
    done = can_run("--", "sh", "-c", f"{shlex.join(inner)}; echo status $?; pgrep sleep")
    assert b"kernel native" in done.stderr
    assert done.stdout.splitlines()[0].split()[0] == b"can7"
    assert done.stdout.splitlines()[-1] == f"status {128 + signal.SIGSEGV}".encode(), "and nothing survives"


def test_virtual_time_costs_nothing_to_wait_and_always_begins_alike() -> None:
    began_s = time.monotonic()
    done = can_run("--virtual-time", "--", "sh", "-c", "sleep 86400; date -u +%F; exec nosuchcommand")
    assert time.monotonic() - began_s < 3600
    assert done.stdout == b"2020-01-02\n"
    assert done.returncode == 127


def test_time_out_and_nothing_survives(tmp_path: Path) -> None:
    mark = tmp_path / "alive"
    script = f"while :; do date >{mark}; sleep 0.1; done"
    done = can_run("--timeout", "3", "--", "sh", "-c", script)
    assert done.returncode == 124
    assert b"--timeout" in done.stderr
    mark.unlink()
    time.sleep(0.5)
    assert not mark.exists()


@pytest.mark.sweep
def test_containers_that_permit_no_namespaces_do(tmp_path: Path) -> None:
    mark = tmp_path / "alive"
    (tmp_path / "unshare").write_text("#!/bin/sh\nexit 1\n")
    (tmp_path / "unshare").chmod(0o755)
    env = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    script = f"(while :; do date >{mark}; sleep 0.1; done) & until [ -e {mark} ]; do sleep 0.1; done; exit 3"
    done = can_run("--backend", "uml", "--", "sh", "-c", script, env=env)
    assert done.returncode == 3
    mark.unlink()
    time.sleep(0.5)
    assert not mark.exists(), "nothing survives"


def test_ending_the_tool_ends_the_guest(tmp_path: Path) -> None:
    mark = tmp_path / "alive"
    running = subprocess.Popen([*CRUX, "can", "run", "--", "sh", "-c", f"while :; do date >{mark}; sleep 0.1; done"])
    while not mark.exists():
        time.sleep(0.05)
    running.terminate()
    assert running.wait(600) == 128 + signal.SIGTERM
    mark.unlink()
    time.sleep(0.5)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no command"),
        (("-i", "a/b", "--", "true"), "'a/b' is no interface name"),
        (("-i", "a,a", "--", "true"), "twice"),
        (("--timeout", "-1", "--", "true"), "'-1': expected a number above 0"),
        (("--virtual-time", "--backend", "qemu", "--", "true"), "only the back-end uml has it"),
    ],
)
def test_wrong_usage_is_said(words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        status = main(["can", "run", *words])
    except SystemExit as ended:
        status = int(ended.code or 0)
    assert status == 2
    assert said in capsys.readouterr().err


def test_a_kernel_that_cannot_be_built_is_said(tmp_path: Path) -> None:
    """Without the build tools on PATH and with an empty cache."""
    env = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "PATH": str(tmp_path)}
    os.symlink("/usr/bin/dpkg-query", tmp_path / "dpkg-query")
    done = can_run("--backend", "uml", "--", "true", env=env)
    assert done.returncode == 125
    assert "apt-get install bc binutils bison flex gcc make xz-utils" in done.stderr.decode()
