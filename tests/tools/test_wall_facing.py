"""Meshes of a wall whose triangles look inwards, or either way, are read as the wall that they show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from crux_simulation.wall.facing import facing_out
from crux_simulation.wall.surface import Surface

OUT, PATH = np.array([0.0, 0.0, 1.0]), Path("scan.ply")
AWAY = "crux wall import: scan.ply: its triangles look away from --outward 0 0 1: all are turned around\n"
MIXED = "crux wall import: scan.ply: its triangles looked either way: turned as their neighbours are\n"


def wall() -> Surface:
    """An open sheet of 1 m, and two boxes in front of it."""
    sheet = trimesh.creation.box((1.0, 1.0, 0.1))
    sheet.update_faces(sheet.face_normals[:, 2] > 0.5)
    boxes = [trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((x, 0.2, 0.11)) for x in (-0.3, 0.3)]
    mesh = trimesh.util.concatenate([sheet, *boxes]).subdivide_to_size(0.06)
    mesh.merge_vertices()
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int64))


def alike(one: Surface, other: Surface) -> float:
    """The share of triangles that look the same way."""
    return float(((one.mesh.face_normals * other.mesh.face_normals).sum(axis=1) > 0.0).mean())


def test_a_right_mesh_is_left_alone(capsys: pytest.CaptureFixture[str]) -> None:
    surface = wall()
    assert facing_out(surface, OUT, PATH) is surface
    assert capsys.readouterr().err == ""


def test_a_mesh_inside_out_is_turned(capsys: pytest.CaptureFixture[str]) -> None:
    right = wall()
    assert alike(facing_out(Surface(right.vertices, right.faces[:, ::-1]), OUT, PATH), right) == 1.0
    assert capsys.readouterr().err == AWAY


@pytest.mark.parametrize("share", [0.5, 0.7])
def test_triangles_that_look_either_way_are_turned_as_their_neighbours(
    share: float, capsys: pytest.CaptureFixture[str]
) -> None:
    right = wall()
    faces = right.faces.copy()
    some = np.random.default_rng(3).uniform(size=len(faces)) < share
    faces[some] = faces[some, ::-1]
    assert alike(facing_out(Surface(right.vertices, faces), OUT, PATH), right) == 1.0
    assert capsys.readouterr().err == MIXED
