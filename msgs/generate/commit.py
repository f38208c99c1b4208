"""Writes the commit that is built, for C++ (commit.hpp) and Python (crux_commit.py). Run by every build."""

from __future__ import annotations

import argparse
import subprocess
from pathlib import Path

from . import write_changed

REPOSITORY = Path(__file__).resolve().parents[2]
DESCRIBE = ("git", "describe", "--always", "--exclude=*", "--abbrev=12", "--dirty")


def commit() -> str:
    """Twelve digits, with -dirty where a tracked file differs; `unknown` in an archive of the sources."""
    if not (REPOSITORY / ".git").exists():  # a repository further up would be another project's
        return "unknown"
    try:
        return subprocess.run(DESCRIBE, cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to write into (build/gen)")
    out = parser.parse_args().out
    name = commit()
    constant = f'namespace crux_msgs {{\nconst char* const kCommit = "{name}";\n}}  // namespace crux_msgs\n'
    write_changed(out / "cpp/commit.cpp", f'#include "commit.hpp"\n\n{constant}')
    write_changed(out / "python/crux_commit.py", f'COMMIT: str = "{name}"\n')


if __name__ == "__main__":
    main()
