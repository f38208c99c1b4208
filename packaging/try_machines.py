"""Runs the first command of the README on machines of several kinds, each a chroot, and says in a table what happened.

    python packaging/try_machines.py [--only WORD] [--folder build/machines]

Needs root, mmdebstrap and a network. `bare` is a new system with git and make on which `make climb` runs from nothing;
the other machines of a release stand on its packages and build a checkout of their own. Nothing stays mounted. How
this machine reaches package registries (settings of apt, pip, uv and cargo, certificates) is copied into each chroot.
"""

from __future__ import annotations

import argparse
import os
import resource
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SETTINGS = (
    "/etc/pip.conf",
    "/etc/uv",
    "/etc/apt/apt.conf.d",
    "/etc/apt/auth.conf.d",
    "/etc/hosts",
    "/etc/resolv.conf",
    "/etc/ssl/certs/ca-certificates.crt",
    "/usr/local/share/ca-certificates",
    "~/.config/pip",
    "~/.config/uv",
    "~/.cargo/config.toml",
    "~/.netrc",
)
VARIABLES = ("PIP_", "UV_", "CARGO_", "SSL_CERT", "REQUESTS_CA", "CURL_CA", "http_proxy", "https_proxy", "no_proxy")
RELEASES = {"bookworm": "Debian 12", "trixie": "Debian 13", "jammy": "Ubuntu 22.04", "noble": "Ubuntu 24.04"}
PLANS = ".venv/bin/crux --version && .venv/bin/crux plan msgs/scenarios/climb-one-step.yaml -o plan.mcap"
BUILDS = f"cmake --fresh -S . -B build/cmake -G Ninja && make programs && {PLANS}"
SETS_UP = f"rm -rf .venv && make setup-programs && {PLANS}"
GENERATES = f"make configure-programs && cmake --build build/cmake --target crux_generate crux_commit && {PLANS}"
ALONE = "unshare -n sh -c 'ip link set lo up && make climb'"
MOUNTS = """set -eu
mount -t overlay overlay -o "lowerdir=$1,upperdir=$2/upper,workdir=$2/work" "$2/root"
mount -t proc proc "$2/root/proc"
mkdir -p "$2/root/dev/shm"
mount -t tmpfs tmpfs "$2/root/dev/shm"
exec chroot "$2/root" su - "$3" -c "$4"
"""


@dataclass(frozen=True)
class Machine:
    """`before` runs as root; `command` in the checkout, as `user`; it has to end in status 0 and say `says`.

    `bare`: with none of the packages and products of the first machine; `clone`: with a checkout of its own.
    """

    name: str
    command: str = BUILDS
    before: str = "true"
    says: str = "planned and checked"
    checkout: str = "crux"
    user: str = "root"
    bare: bool = False
    clone: bool = False


# What the first one compiled serves the others but the path with spaces: CMake looks for tools anew, and ninja compiles
# what that changes.
MACHINES = (
    Machine("bare", "make climb", says="the robot is at the goal", bare=True, clone=True),
    Machine("no multicast route", ALONE, says="the robot is at the goal"),
    Machine("libgtest-dev alone", before="apt-get install -qq -y libgtest-dev"),
    Machine("gcc-arm-none-eabi alone", before="apt-get install -qq -y --no-install-recommends gcc-arm-none-eabi"),
    Machine("broken python3 first", SETS_UP, before="ln -s /bin/false /usr/local/bin/python3"),
    Machine("pypy3 first", SETS_UP, before="apt-get install -qq -y pypy3; ln -s /usr/bin/pypy3 /usr/local/bin/python3"),
    Machine(
        "without .git", "tools/setup/version && " + BUILDS, before="rm -rf /root/crux/.git", says="(commit unknown)"
    ),
    Machine("a user with sudo", GENERATES, user="climber", bare=True, clone=True),
    Machine(
        "a user without sudo",
        "! make climb",
        before="rm /etc/sudoers.d/climber",
        says="as root: apt-get install",
        user="climber",
        bare=True,
        clone=True,
    ),
    Machine("path with spaces", "make climb docs", says="the robot is at the goal", checkout="my crux", clone=True),
)


# Ubuntu 22.04 has Python 3.10.
TOO_OLD = (Machine("bare", "! make climb", says="needs CPython 3.11 to 3.13", bare=True, clone=True),)


def make_base(release: str, base: Path) -> str:
    """A new system with git, make and a user; returns why it cannot be had, or nothing."""
    if (base / "etc" / "sudoers.d" / "climber").exists():
        return ""
    shutil.rmtree(base, ignore_errors=True)
    base.parent.mkdir(parents=True, exist_ok=True)
    words = ["mmdebstrap", "-q", "--variant=minbase", "--include=apt,git,make,ca-certificates,sudo", release, str(base)]
    words += ["--components=main,universe"] if RELEASES[release].startswith("Ubuntu") else []
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0 or not (base / "etc" / "sudoers.d").is_dir():
        shutil.rmtree(base, ignore_errors=True)
        reasons = [line for line in done.stderr.splitlines() if line.startswith(("E:", "Err", "W:"))] or ["no suite"]
        return f"its packages cannot be had from here: {reasons[0]}"
    for name in SETTINGS:
        path = Path(name).expanduser()
        place = base / path.relative_to("/")
        if path.is_dir():
            shutil.copytree(path, place, dirs_exist_ok=True)
        elif path.exists():
            place.parent.mkdir(parents=True, exist_ok=True)
            place.unlink(missing_ok=True)
            shutil.copy(path, place)
    subprocess.run(["chroot", base, "useradd", "-m", "-s", "/bin/sh", "climber"], check=True)
    told = [f"export {k}={shlex.quote(v)}" for k, v in os.environ.items() if k.startswith(VARIABLES)]
    (base / "etc" / "profile.d" / "registries.sh").write_text("\n".join(told) + "\n")
    (base / "etc" / "sudoers.d" / "climber").write_text("climber ALL=(ALL) NOPASSWD: ALL\n")
    return ""


@dataclass(frozen=True)
class Row:
    """What happened on a machine: `result` is ok, or what was missing; MB are what it wrote."""

    release: str
    machine: str
    result: str
    wall_s: float = 0.0
    cpu_s: float = 0.0
    disk_mb: float = 0.0


def run(machine: Machine, release: str, folder: Path, jobs: int) -> Row:
    """Lays the machine out in `folder` and runs its command; the output is in folder/MACHINE.log."""
    own, bare = folder / machine.name.replace(" ", "-"), folder / "bare" / "upper"
    shutil.rmtree(own, ignore_errors=True)
    for part in ("upper", "work", "root"):
        (own / part).mkdir(parents=True)
    lower = f"{folder}/base" if machine.bare else f"{bare}:{folder}/base"
    home = "root" if machine.user == "root" else f"home/{machine.user}"
    place = own / "upper" / home / machine.checkout
    if machine.clone:
        subprocess.run(["git", "clone", "-q", "--no-hardlinks", ROOT, place], check=True)
    owner = (folder / "base" / home).stat().st_uid
    for path in (place.parent, place, *place.rglob("*")):
        if path.exists():
            os.chown(path, owner, owner, follow_symlinks=False)

    def chroot(user: str, command: str) -> subprocess.CompletedProcess[str]:
        words = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-c", MOUNTS, "sh", lower, str(own)]
        return subprocess.run(
            [*words, user, command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
        )

    prepared = chroot("root", f"set -e; apt-get update -qq; {machine.before}")
    if prepared.returncode != 0:
        return Row(release, machine.name, f"could not be laid out: {prepared.stdout.splitlines()[-1:]}")
    begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    done = chroot(machine.user, f"export JOBS={jobs}; cd {shlex.quote(machine.checkout)} && {machine.command}")
    wall_s, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    log = folder / f"{own.name}.log"
    log.write_text(done.stdout, encoding="utf-8")
    fits = done.returncode == 0 and machine.says in done.stdout
    size = subprocess.run(["du", "-sx", "-BMB", own / "upper"], capture_output=True, text=True, check=True).stdout
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if machine.name != "bare":
        shutil.rmtree(own)
    return Row(release, machine.name, "ok" if fits else f"FAILED, see {log}", wall_s, cpu_s, float(size.split("MB")[0]))


def try_release(release: str, folder: Path, only: str, jobs: int) -> Iterator[Row]:
    """The rows of a release; the bare machine comes along where others need it."""
    why = make_base(release, folder / "base")
    if why:
        yield Row(release, "all", f"not tried: {why}")
        return
    for machine in TOO_OLD if release == "jammy" else MACHINES:
        lacks = machine.name == "bare" and not (folder / "bare" / "upper").is_dir()
        if only in f"{release} {machine.name}" or lacks:
            yield run(machine, release, folder, jobs)


def main() -> int:
    """Exit status 0 where every machine that could be had did what it should."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="WORD", help="machines that have this in release and name")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "machines", help="where the chroots lie")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="compilers at a time")
    options = parser.parse_args()
    print(f"{'system':<13} {'machine':<24} {'wall':>9} {'CPU':>8} {'disk':>9}  result", flush=True)
    rows = []
    for release, system in RELEASES.items():
        if options.only.split(" ")[0] in ("", *RELEASES) and not release.startswith(options.only.split(" ")[0]):
            continue
        for row in try_release(release, options.folder.resolve() / release, options.only, options.jobs):
            rows.append(row)
            figures = f"{row.wall_s:7.0f} s {row.cpu_s:6.0f} s {row.disk_mb:6.0f} MB"
            print(f"{system:<13} {row.machine:<24} {figures}  {row.result}", flush=True)
    may_be_missing = {release for release, system in RELEASES.items() if system.startswith("Ubuntu")}
    return int(any(row.result != "ok" and not (row.machine == "all" and row.release in may_be_missing) for row in rows))


if __name__ == "__main__":
    sys.exit(main())
