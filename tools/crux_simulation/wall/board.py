"""The layout of a training board: a table of holds by their places, each a cuboid that can be gripped on all sides."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from crux_tools.errors import UsageError

from crux_simulation.wall.box import Box

COLUMNS = {  # of the table: what begins so is the column, so that names may say more, such as `_assumed`
    "name": ("name", "cell"),
    "x": ("x_m", "x_up_m"),
    "y": ("y_m", "y_left_m"),
    "yaw": ("yaw_deg", "up_deg"),
    "size_x": ("size_x_m",),
    "size_y": ("size_y_m",),
    "size_z": ("size_z_m",),
}
SIZE_M = 0.06  # where the table has none


def read_board(path: Path) -> list[Box]:
    """The holds of a CSV file with columns name (or cell), x_m up the board, y_m to the left, and, as far as they are
    given, yaw_deg (or up_deg) and size_x_m, size_y_m, size_z_m. Raises UsageError with the line that is wrong.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: cannot be read: {error}") from None
    kept = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    rows = list(csv.reader(line for _, line in kept))
    if len(rows) < 2:
        raise UsageError(f"{path}: has no holds: expected a line of column names, and one a hold")
    which = {what: _column(rows[0], begins) for what, begins in COLUMNS.items()}
    missing = [COLUMNS[what][0] for what in ("name", "x", "y") if which[what] is None]
    if missing:
        raise UsageError(f"{path}: no column {', '.join(missing)}; it has {', '.join(rows[0])}")
    found: list[Box] = []
    for (number, _), row in zip(kept[1:], rows[1:], strict=True):
        place = f"{path}:{number}"
        if len(row) != len(rows[0]):
            raise UsageError(f"{place}: {len(row)} values: expected {len(rows[0])}, one for each column")

        def value(what: str, default: float, place: str = place, row: list[str] = row) -> float:
            column = which[what]
            return default if column is None else _number(row[column], f"{place}: {rows[0][column]}")

        name = row[which["name"] or 0].strip()
        if not name or name in {box.name for box in found}:
            raise UsageError(f"{place}: {name!r}: expected a name of its own")
        size = np.array([value(what, SIZE_M) for what in ("size_x", "size_y", "size_z")])
        yaw = math.radians(value("yaw", 0.0))
        position = np.array([value("x", 0.0), value("y", 0.0)])
        found.append(Box(name, position, size, yaw, (True, True), (0.0, 0.0), ""))
    return found


def _column(names: list[str], begins: tuple[str, ...]) -> int | None:
    return next((i for i, name in enumerate(names) if name.strip().lower().startswith(begins)), None)


def _number(text: str, place: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise UsageError(f"{place}: {text!r}: expected a number")
    return value
