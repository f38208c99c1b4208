"""The service of the package crux-runtime, under a systemd that has booted a Debian of its own; needs root."""

from __future__ import annotations

import contextlib
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from crux_contracts import LIMB_NAMES
from crux_msgs import command_t, robot_state_t
from crux_simulation.sim.ports import RunPorts, run_ports
from crux_tools.operator_key import OperatorKey
from crux_tools.operator_link import OperatorLink
from crux_tools.paths import ROOT
from crux_tools.replay.recompute import recompute
from hand_plan import standing_plan
from robot_on_wall import RobotOnWall

pytestmark = [
    pytest.mark.sweep,
    pytest.mark.skipif(os.geteuid() != 0, reason="a container is started by root alone"),
]
PATIENCE_S = 600.0
LOGGED_CYCLES = 500  # what a runtime wrote before its last 0.5 s is in the log when it is killed
UNIT = "crux-runtime"
LOGS = Path("var/log/crux")
USER = "_crux"


def await_true(wanted: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not wanted():
        assert time.monotonic() < end_s
        time.sleep(0.1)


class Computer:
    """A robot's computer: Debian with the package, in a container that shares this machine's network."""

    def __init__(self, root: Path, suite: str, architecture: str) -> None:
        subprocess.run(["make", "packages", f"ARCHITECTURES={architecture}"], cwd=ROOT, check=True, capture_output=True)
        (package,) = (ROOT / "build" / "packages").glob(f"{UNIT}_*_{architecture}.deb")
        install = f"chroot $1 apt-get install -y --no-install-recommends /{package.name}"
        words = ["mmdebstrap", "-q", "--variant=minbase", "--include=systemd,systemd-sysv,dbus"]
        words += ["--skip=check/qemu", f"--arch={architecture}"]
        hooks = [f"--customize-hook=copy-in {package} /", f"--customize-hook={install}"]
        subprocess.run([*words, *hooks, suite, root], check=True, capture_output=True)
        self.root = root
        self.emulated = architecture != "amd64"
        self._pid = 0

    @contextlib.contextmanager
    def on(self) -> Iterator[Computer]:
        """From booting it on until the context is left."""
        words = ["systemd-nspawn", "--boot", "--register=no", "--keep-unit", "--quiet", f"--directory={self.root}"]
        nothing = subprocess.DEVNULL
        with subprocess.Popen(words, stdin=nothing, stdout=nothing, stderr=nothing) as container:
            children = Path(f"/proc/{container.pid}/task/{container.pid}/children")
            await_true(lambda: children.read_text() != "")
            self._pid = int(children.read_text().split()[0])
            try:
                await_true(lambda: self.run("systemctl", "is-system-running") in ("running", "degraded"))
                yield self
            finally:
                container.terminate()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    container.wait(PATIENCE_S)
                container.kill()

    def run(self, *words: str) -> str:
        """What a command writes there."""
        entered = ["nsenter", "--target", str(self._pid), "--all", "env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin"]
        done = subprocess.run([*entered, *words], capture_output=True, text=True, check=False, timeout=PATIENCE_S)
        return (done.stdout + done.stderr).strip()

    def shows(self, what: str) -> str:
        """A property of the service."""
        return self.run("systemctl", "show", UNIT, "--property", what, "--value")

    def await_shows(self, what: str, value: str) -> None:
        """Waits for a value of a property."""
        await_true(lambda: self.shows(what) == value)

    def configure(self, ports: RunPorts) -> None:
        """UDP for SocketCAN, which the kernel below a container need not have; LCM at an address of this run."""
        unit = (ROOT / "packaging" / f"{UNIT}.service").read_text(encoding="utf-8")
        for limb, url in zip(LIMB_NAMES, ports.bus_urls(), strict=True):
            unit = unit.replace(f"--bus {limb}=socketcan:can{limb}", f"--bus {limb}={url}")
        (self.root / "etc" / "systemd" / "system" / f"{UNIT}.service").write_text(unit)
        (self.root / "etc" / "crux" / "runtime.conf").write_text(f"OPTIONS=--lcm {ports.lcm_url}\n")
        self.run("systemctl", "daemon-reload")


class RobotThatWaits(RobotOnWall):
    """Its nodes go on when nobody sends Sync, as a robot's do."""

    def hangs(self) -> bool:
        """By all four limbs."""
        return bool(self._plant.limbs_on_holds().all())

    def _serve(self) -> None:
        while not self._stop.is_set():
            cycle = self._nodes.wait_sync(0.002)
            self._nodes.step(self._plant)
            self._nodes.publish(self._plant)
            self.cycle = self.cycle if cycle is None else cycle


@pytest.fixture(scope="module")
def owner(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """His private key."""
    path = tmp_path_factory.mktemp("owner") / "key.pem"
    OperatorKey.new(path)
    return path


@pytest.fixture(scope="module", params=["bookworm-amd64", "trixie-amd64", "bookworm-arm64"])
def computer(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Computer]:
    """Another architecture's runs where the kernel starts its programs by qemu-user-static."""
    with Computer(tmp_path_factory.mktemp("computer") / "root", *request.param.split("-")).on() as computer:
        yield computer


def test_what_it_lacks_it_says_and_it_is_tried_again(computer: Computer, owner: Path) -> None:
    keys = computer.root / "etc" / "crux" / "keys"
    for lacks in ("--keys /etc/crux/keys: No such file", "bus socketcan:canLF"):
        computer.run("systemctl", "start", "--no-block", UNIT)
        await_true(lambda: computer.shows("NRestarts") not in ("", "0"))
        assert computer.shows("ExecMainStatus") in ("0", "2")  # 0: it runs just now
        assert lacks in computer.run("journalctl", "-u", UNIT)
        computer.run("systemctl", "stop", UNIT)
        keys.parent.mkdir(exist_ok=True)
        keys.write_text(OperatorKey(owner).line("operate", "owner") + "\n")


def test_after_a_crash_and_a_standstill_it_takes_over_the_robot_as_it_hangs(computer: Computer, owner: Path) -> None:
    plan = standing_plan()
    with run_ports() as ports, OperatorLink(ports.lcm_url, key=owner) as operator:
        computer.configure(ports)
        computer.run("systemctl", "start", "--no-block", UNIT)
        await_true(lambda: computer.shows("MainPID") != "0")
        assert computer.shows("ActiveState") == "activating", "no node has answered yet"
        with RobotThatWaits(ports, plan) as robot:
            computer.await_shows("ActiveState", "active")
            pid = computer.shows("MainPID")
            assert computer.run("stat", "--format=%U", f"/proc/{pid}") == USER
            assert "not in real time: memory" not in computer.run("journalctl", "-u", UNIT)
            assert "no SCHED_FIFO" not in computer.run("journalctl", "-u", UNIT)
            assert "is not locked" not in computer.run("journalctl", "-u", UNIT)
            operator.upload(plan)
            robot.await_state(robot_state_t.READY)
            if not computer.emulated:  # that one's lateness may make the robot hold before it is to start
                operator.send(command_t.START, plan.plan_id)
            await_true(robot.hangs)
            for restarts, signal in enumerate(("KILL", "STOP"), 1):
                robot.await_cycle(LOGGED_CYCLES)
                computer.run("systemctl", "kill", f"--signal={signal}", UNIT)
                computer.await_shows("NRestarts", str(restarts))
                computer.await_shows("ActiveState", "active")
                robot.await_state(robot_state_t.IDLE)
                assert robot.hangs()
            computer.run("systemctl", "stop", UNIT)
            assert computer.shows("ActiveState") == "inactive"
            assert robot.hangs()
    logs = sorted(path.name for path in (computer.root / LOGS).iterdir())
    assert logs == ["climb-2.idle.mcap", "climb-3.idle.mcap", "climb.mcap"], "a plan was taken in the first alone"
    rounding = 1e-9 if computer.emulated else 0.0  # SI units: another processor's libraries round otherwise
    assert all(recompute(computer.root / LOGS / name, rounding).ok for name in logs)


def test_removed_it_leaves_what_its_owner_made(computer: Computer) -> None:
    computer.run("dpkg", "--purge", UNIT)
    left = computer.run("find", "/", "-xdev", "-name", "*crux*", "-not", "-name", "*.deb").split()
    assert sorted(left) == ["/etc/crux", f"/etc/systemd/system/{UNIT}.service", f"/{LOGS}"]
