"""The points of a PCD file (Point Cloud Library), ASCII or binary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from crux_tools.errors import UsageError

from crux_simulation.wall.surface import Array

KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(path: Path) -> Array:
    """Points (n, 3) in the file's unit and frame. Raises UsageError where the file is damaged, or compressed."""
    header, data = {}, path.read_bytes()
    at = 0
    while "DATA" not in header:
        end = data.find(b"\n", at)
        words = data[at:end].decode("ascii", "replace").split() if end >= 0 else []
        if end < 0 or at > 4096:
            raise UsageError(f"{path}: has no line DATA: is no PCD file")
        at = end + 1
        if words and not words[0].startswith("#"):
            header[words[0]] = words[1:]
    try:
        fields, form = header["FIELDS"], header["DATA"][0]
        counts = [int(count) for count in header.get("COUNT", ["1"] * len(fields))]
        names = [f"{name} {i}" for i, name in enumerate(fields)]
        kinds = [KINDS[kind] + size for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)]
        columns = [names[fields.index(axis)] for axis in "xyz"]
        record = np.dtype([(n, "<" + k, (c,)) for n, k, c in zip(names, kinds, counts, strict=True)])
        total = int(header["POINTS"][0])
        if form == "binary":
            rows = np.frombuffer(data, record, total, at)
            points = np.column_stack([rows[column] for column in columns]).astype(float)
        elif form == "ascii":
            ends = np.cumsum(counts)
            table = np.array(data[at:].split(), float).reshape(total, int(ends[-1]))
            points = table[:, [int(ends[fields.index(axis)]) - 1 for axis in "xyz"]]
        else:
            hint = "make it binary: pcl_convert_pcd_ascii_binary OLD.pcd NEW.pcd 1"
            raise UsageError(f"{path}: DATA {form}: expected ascii or binary; {hint}")
    except (KeyError, IndexError, ValueError, TypeError) as error:
        raise UsageError(f"{path}: cannot be read as a PCD file: {error}") from None
    return points
