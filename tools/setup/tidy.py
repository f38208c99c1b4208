"""clang-tidy over those of the files given whose content, headers, flags or checks it has not passed before.

usage: tidy.py BUILD_FOLDER JOBS FILE …   (from the root, after a build: headers are those that ninja saw)

What passed is remembered in ~/.cache/crux/tidy by a digest of all that decides: clang-tidy's version, .clang-tidy, the
compile commands, and the bytes of the source and of every header. Paths count relative to the root, so that all
clones share the memory.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

KEPT_S = 60 * 24 * 3600.0  # digests that nobody asked for in so long are forgotten
ROOT = Path.cwd().resolve()


def memory() -> Path:
    """~/.cache/crux/tidy, or below $XDG_CACHE_HOME."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "crux" / "tidy"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@cache
def digest_of(path: Path) -> str:
    """A file as it counts: its name below the root and its bytes."""
    return f"{path}".removeprefix(f"{ROOT}/") + hashlib.sha256(path.read_bytes()).hexdigest()


def headers_by_object(build: Path) -> dict[str, list[Path]]:
    """What ninja saw each object include; objects that have changed since are left out."""
    shown = subprocess.run(["ninja", "-C", str(build), "-t", "deps"], capture_output=True, text=True, check=True).stdout
    blocks = re.findall(r"^(\S.*): #deps \d+, deps mtime \d+ \(VALID\)\n((?: +.*\n)*)", shown, re.MULTILINE)
    return {name: [(build / line.strip()).resolve() for line in lines.splitlines()] for name, lines in blocks}


def keys(build: Path, files: list[Path]) -> dict[Path, str | None]:
    """The digest of each file; None where ninja does not know its headers, or one of them is gone."""
    version = subprocess.run(["clang-tidy", "--version"], capture_output=True, text=True, check=True).stdout
    shared = version + Path(".clang-tidy").read_text(encoding="utf-8")
    headers = headers_by_object(build)
    commands: dict[Path, list[dict[str, str]]] = {}
    for entry in json.loads((build / "compile_commands.json").read_text(encoding="utf-8")):
        commands.setdefault(Path(entry["file"]).resolve(), []).append(entry)
    found: dict[Path, str | None] = {}
    for file in files:
        entries = commands.get(file.resolve(), [])
        try:
            objects = [entry["command"].split(" -o ")[1].split()[0] for entry in entries]
            seen = {path for name in objects for path in headers[name]}
            parts = [entry["command"].replace(str(ROOT), ".") for entry in entries]
            parts += sorted(digest_of(path) for path in seen | {file.resolve()})
        except (KeyError, FileNotFoundError):
            parts = []
        found[file] = hashlib.sha256("\0".join([shared, *parts]).encode()).hexdigest() if parts and entries else None
    return found


def passes(build: Path, file: Path, key: str | None) -> bool:
    """Runs clang-tidy; shows what it finds, remembers what passes."""
    command = ["clang-tidy", "--quiet", "-p", str(build), str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode == 0 and key is not None:
        (memory() / key).touch()
    elif done.returncode != 0:
        print(done.stdout or done.stderr, end="", flush=True)
    return done.returncode == 0


def main() -> int:
    build, jobs, files = Path(sys.argv[1]).resolve(), int(sys.argv[2]), [Path(name) for name in sys.argv[3:]]
    folder = memory()
    for old in folder.iterdir():
        if time.time() - old.stat().st_mtime > KEPT_S:
            old.unlink(missing_ok=True)
    found = keys(build, files)
    fresh = []
    for file, key in found.items():
        if key is not None and (folder / key).exists():
            (folder / key).touch()
        else:
            fresh.append(file)
    with ThreadPoolExecutor(jobs) as pool:
        passed = list(pool.map(lambda file: passes(build, file, found[file]), fresh))
    print(f"clang-tidy: {len(files)} files, {len(fresh)} of them new, {passed.count(False)} refused")
    return int(not all(passed))


if __name__ == "__main__":
    sys.exit(main())
