"""What a result depends on beside its job: crux, the Python packages it imports, and the robots' descriptions."""

from __future__ import annotations

import platform
import re
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from crux_contracts.robot import load_robot, robot_hash, robot_names
from crux_tools.paths import version_and_requirements

Environment = dict[str, str]


@cache
def environment() -> Environment:
    """Of this process: versions and hashes by what they are of."""
    from crux_commit import COMMIT

    own_version, requirements = version_and_requirements()
    found = {"crux": own_version, "commit": COMMIT, "Python": platform.python_version()}
    for requirement in requirements:
        name = re.split(r"[^\w.-]", requirement)[0]
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found | {f"robot {name}": robot_hash(load_robot(name).folder)[:12] for name in robot_names()}


def differences(here: Environment, there: Environment) -> str:
    """What is not the same, in words; empty where nothing is."""
    names = sorted({*here, *there}, key=str.lower)
    return ", ".join(
        f"{name} {there.get(name, 'none')} instead of {here.get(name, 'none')}"
        for name in names
        if here.get(name) != there.get(name)
    )
