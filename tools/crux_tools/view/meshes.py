"""The pictures of a robot's links: meshes that its URDF names, where their files are there.

A log carries robot.yaml and the URDF but no meshes: they come from the robot's folder on this machine.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts import robot as robots
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Mesh:
    """A mesh in its link's frame; position [m], quaternion w, x, y, z."""

    file: Path
    scale: tuple[float, ...]
    position: np.ndarray
    wxyz: np.ndarray


def _numbers(element: ET.Element | None, name: str, default: str) -> tuple[float, ...]:
    return tuple(map(float, (default if element is None else element.get(name, default)).split()))


def meshes_of(robot: robots.Robot) -> dict[str, list[Mesh]]:
    """By link. A link with a mesh whose file is not there is left out, to be drawn by the shapes that collide."""
    found: dict[str, list[Mesh]] = {}
    for link in ET.parse(robot.urdf_path).getroot().iter("link"):
        meshes = []
        pictures = [(visual, visual.find("geometry/mesh")) for visual in link.findall("visual")]
        for visual, mesh in pictures:
            if mesh is None:
                break
            name = mesh.get("filename", "").removeprefix("file://")
            inner = name.removeprefix("package://").partition("/")[2] if name.startswith("package://") else name
            file = next((f / inner for f in (robot.folder, robots.ROBOTS / robot.name) if (f / inner).is_file()), None)
            if file is None:
                break
            origin = visual.find("origin")
            turn = Rotation.from_euler("xyz", _numbers(origin, "rpy", "0 0 0")).as_quat()[[3, 0, 1, 2]]
            place = np.array(_numbers(origin, "xyz", "0 0 0"))
            meshes.append(Mesh(file, _numbers(mesh, "scale", "1 1 1"), place, turn))
        if pictures and len(meshes) == len(pictures):
            found[link.get("name", "")] = meshes
    return found


def add_meshes(
    scene: Any, name: str, meshes: list[Mesh], ghost_rgb: tuple[int, int, int] | None, opacity: float
) -> None:
    """Adds them below the frame called `name`, as a ghost where a colour is given."""
    import trimesh

    for i, mesh in enumerate(meshes):
        shape: Any = trimesh.load(mesh.file, force="mesh")
        shape.apply_scale(mesh.scale)
        place: dict[str, Any] = {"position": mesh.position, "wxyz": mesh.wxyz}
        if ghost_rgb is None:
            scene.add_mesh_trimesh(f"{name}/mesh{i}", shape, **place)
        else:
            more = {"color": ghost_rgb, "opacity": opacity, "cast_shadow": False}
            scene.add_mesh_simple(f"{name}/mesh{i}", shape.vertices, shape.faces, **more, **place)
