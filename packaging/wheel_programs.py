"""Build hook of hatchling: compiles the programs that crux starts and puts them into the wheel, in crux_tools/programs.

Skipped by HATCH_BUILD_NO_HOOKS=true: the wheel is then Python alone, as the Debian packages need it.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

INSIDE = "crux_tools/programs"
SYSTEM = re.compile(r"lib(c|m|dl|rt|pthread|stdc\+\+|gcc_s)\.so")  # every system has them
OF_PYTHON = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "MAKEFLAGS", "MAKELEVEL")  # of whoever builds the wheel


def shared_libraries(program: Path) -> dict[str, Path]:
    """Paths by name of what a program loads beyond C and C++; MuJoCo, which Python loads, is not found."""
    shown = subprocess.run(["ldd", program], check=True, capture_output=True, text=True).stdout
    found = re.findall(r"^\s*(\S+) => (/.+) \(0x", shown, re.MULTILINE)
    return {name: Path(path) for name, path in found if not SYSTEM.match(name)}


def debian_licences(libraries: list[str]) -> dict[str, str]:
    """Debian's copyright files by their place in the wheel; empty on other systems."""
    if shutil.which("dpkg-query") is None:
        return {}
    words = ["dpkg-query", "-S", *(f"*/{name}" for name in libraries)]  # finds LCM's nowhere, which is Python's
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    packages = sorted(set(re.findall(r"^([^:, ]+)(?::\w+)?: ", found.stdout, re.MULTILINE)))
    files = {name: Path("/usr/share/doc") / name / "copyright" for name in packages}
    return {str(file): f"{INSIDE}/licences/{name}" for name, file in files.items() if file.exists()}


class ProgramsHook(BuildHookInterface[Any]):
    """Named in pyproject.toml."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 (hatchling's signature)
        """Runs `make programs` without apt-get, and adds what it built."""
        root = Path(self.root)
        environment = {name: value for name, value in os.environ.items() if name not in OF_PYTHON}
        made = subprocess.run(["make", "-C", root, "programs"], env=environment | {"CRUX_SKIP_APT": "1"}, check=False)
        if made.returncode:
            raise RuntimeError(
                f"crux's programs could not be built, see above. `make programs` in {root} also installs what the "
                "build needs (tools/setup/apt-packages.txt)."
            )
        stage = root / "build" / "wheel"
        shutil.rmtree(stage, ignore_errors=True)
        for component in ("runtime", "planner", "sim"):
            install = ["cmake", "--install", f"{root}/build/cmake", "--prefix", str(stage), "--strip"]
            subprocess.run([*install, "--component", component], check=True, stdout=subprocess.DEVNULL)
        programs = [stage / "bin" / "crux-runtime", *(stage / "lib" / "crux").iterdir()]
        used = {name: path for program in programs for name, path in shared_libraries(program).items()}
        glib = next(path for name, path in used.items() if name.startswith("libglib-"))  # a bare system has none
        build_data["force_include"] |= {str(path): f"{INSIDE}/{path.name}" for path in programs}
        build_data["force_include"][str(glib)] = f"{INSIDE}/{glib.name}"
        build_data["force_include"] |= debian_licences(sorted(used))
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"
