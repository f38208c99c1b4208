"""The robot description that a log carries, and whether it is still the one on this machine."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from crux_contracts.robot import Robot, RobotError, load_robot, robot_names

SHOWN = 12  # digits of a hash that tell it from another


def inside(name: str) -> str:
    """A file's name without any step that leads out of a folder, as the runtime names the meshes in a log."""
    return "/".join(part for part in name.split("/") if part not in {"", ".", ".."})


@contextmanager
def robot_of(name: str, files: dict[str, bytes]) -> Iterator[Robot]:
    """The robot that `files` (robot.yaml, URDF, meshes, as a log has them) describe; its folder goes with the context.

    Where there are none, or none that this crux reads, it is the robot called `name` on this machine. Raises RobotError
    where that cannot be read either.
    """
    with tempfile.TemporaryDirectory(prefix="crux-robot-") as folder:
        for file, content in files.items():
            path = Path(folder) / inside(file)
            with suppress(OSError, ValueError):  # a name that no file can have
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
        try:
            robot = load_robot(Path(folder))
        except RobotError:
            robot = load_robot(name)
        yield robot


def difference(metadata: dict[str, str], files: dict[str, bytes]) -> str | None:
    """One sentence where the robot that a log (or plan) was made with is not the one described here; else None."""
    name, logged = metadata.get("robot", ""), metadata.get("robot_sha256", "")
    here = load_robot(name) if name in robot_names() else None
    if not files:
        if here is None or here.hash == logged:
            return None
        return (
            f"made with another description of {name} than {here.folder} has now, or by an older crux, and carries "
            "none: pictures and what is computed from it may be wrong"
        )
    with robot_of(name, files) as robot:
        if here is not None and robot.folder == here.folder:
            return (
                f"the log's description of {name} is of a form this crux does not read: {here.folder} is used instead"
            )
        if here is None or robot.hash == here.hash:
            return None
        return (
            f"the description of {name} has changed since ({robot.hash[:SHOWN]}… in the log, {here.hash[:SHOWN]}… in "
            f"{here.folder}): the log's own is used"
        )
