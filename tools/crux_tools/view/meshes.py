"""The pictures of a robot's links: meshes that its URDF names, where their files are there.

A log carries them beside robot.yaml and the URDF. Those of older logs come from the robot's folder on this machine.
"""

from __future__ import annotations

import base64
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts import robot as robots
from scipy.spatial.transform import Rotation

from crux_tools.telemetry.description import inside

KINDS = {".obj", ".off", ".ply", ".stl"}  # as large as what they hold: the library unpacks archives without a limit


@dataclass(frozen=True)
class Mesh:
    """A mesh in its link's frame; position [m], quaternion w, x, y, z."""

    file: Path
    scale: tuple[float, ...]
    position: np.ndarray
    wxyz: np.ndarray


def _numbers(element: ET.Element | None, name: str, default: str) -> tuple[float, ...]:
    return tuple(map(float, (default if element is None else element.get(name, default)).split()))


def _file(robot: robots.Robot, inner: str) -> Path | None:
    """A mesh of the robot's folder, whether a log carries it there or this machine has it; links do not lead out."""
    here = robots.robot_folders().get(robot.name, robot.folder)
    for folder, name in ((robot.folder, inner), (robot.folder, inside(inner)), (here, inner)):
        path = (folder / name).resolve()
        if path.suffix.lower() in KINDS and path.is_relative_to(folder.resolve()) and path.is_file():
            return path
    return None


def meshes_of(robot: robots.Robot) -> dict[str, list[Mesh]]:
    """By link. A link with a mesh whose file is not there, or not of KINDS, is left out, to be drawn by the shapes that
    collide."""
    found: dict[str, list[Mesh]] = {}
    for link in ET.parse(robot.urdf_path).getroot().iter("link"):
        meshes = []
        pictures = [(visual, visual.find("geometry/mesh")) for visual in link.findall("visual")]
        for visual, mesh in pictures:
            if mesh is None:
                break
            name = mesh.get("filename", "").removeprefix("file://")
            inner = name.removeprefix("package://").partition("/")[2] if name.startswith("package://") else name
            file = _file(robot, inner)
            if file is None:
                break
            origin = visual.find("origin")
            turn = Rotation.from_euler("xyz", _numbers(origin, "rpy", "0 0 0")).as_quat()[[3, 0, 1, 2]]
            place = np.array(_numbers(origin, "xyz", "0 0 0"))
            meshes.append(Mesh(file, _numbers(mesh, "scale", "1 1 1"), place, turn))
        if pictures and len(meshes) == len(pictures):
            found[link.get("name", "")] = meshes
    return found


def drawn_mesh(mesh: Mesh) -> dict[str, Any]:
    """For the page: corners, their normals and the triangles' corners as little-endian bytes in base64."""
    import trimesh

    shape: Any = trimesh.load(mesh.file, force="mesh")
    shape.apply_scale(mesh.scale)
    return {
        "kind": "mesh",
        "size": [1.0, 1.0, 1.0],
        "position": mesh.position.tolist(),
        "wxyz": mesh.wxyz.tolist(),
        "rgb": [int(channel) for channel in shape.visual.main_color[:3]],
        "corners": _packed(shape.vertices, "<f4"),
        "normals": _packed(shape.vertex_normals, "<f4"),
        "faces": _packed(shape.faces, "<u4"),
    }


def _packed(table: Any, kind: str) -> str:
    return base64.b64encode(np.asarray(table, kind).tobytes()).decode()
