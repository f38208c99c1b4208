"""Limbs made up at random, as URDF: the kinds that robots have, with any offsets, tilts, mounts and joint senses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
FAMILIES = ("wrist in a point", "shoulder in a point", "three parallel", "anything")
INERTIAL = (
    '<inertial><mass value="0.3"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial>'
)


def drawn(family: str, joints: int, rng: np.random.Generator) -> tuple[list[Array], list[Array], list[Array]]:
    """Of a limb: its joints' axes, and the places [m] and turns [rad] of its joints and the tip, each in the one before
    it.
    """
    axes = [_unit(rng) for _ in range(joints)]
    xyz = [rng.uniform(-0.2, 0.2, 3) for _ in range(joints + 1)]
    rpy = [rng.uniform(-np.pi, np.pi, 3) for _ in range(joints + 1)]
    if family == "wrist in a point":
        xyz[joints - 2], xyz[joints - 1] = np.zeros(3), np.zeros(3)
    elif family == "shoulder in a point":
        xyz[1], xyz[2] = np.zeros(3), np.zeros(3)
    elif family == "three parallel":
        axes[1:4] = [rng.choice([-1.0, 1.0]) * np.array([0.0, 0.0, 1.0]) for _ in range(3)]
        rpy[2], rpy[3] = rpy[2] * [0.0, 0.0, 1.0], rpy[3] * [0.0, 0.0, 1.0]
    return axes, xyz, rpy


def urdf(family: str, joints: int, seed: int) -> str:
    """A limb of 4 to 7 joints j1.. from link base to link tip. Some joints are continuous, some behind a fixed one."""
    rng = np.random.default_rng(seed)
    axes, xyz, rpy = drawn(family, joints, rng)
    parts, parent = ['<robot name="random"><link name="base"/>'], "base"

    def hang(name: str, kind: str, child: str, place: tuple[Array, Array], more: str = "") -> None:
        nonlocal parent
        parts.append(f'<link name="{child}">{INERTIAL}</link><joint name="{name}" type="{kind}">')
        parts.append(f'<parent link="{parent}"/><child link="{child}"/>')
        parts.append(f'<origin xyz="{_text(place[0])}" rpy="{_text(place[1])}"/>{more}</joint>')
        parent = child

    for i in range(joints):
        if rng.random() < 0.3:
            hang(f"seam{i}", "fixed", f"plate{i}", (rng.uniform(-0.1, 0.1, 3), rng.uniform(-3, 3, 3)))
        turning = rng.random() < 0.2
        low, high = rng.uniform(-np.pi, -0.5), rng.uniform(0.5, np.pi)
        limit = "" if turning else f'<limit lower="{low}" upper="{high}" effort="1" velocity="1"/>'
        kind = "continuous" if turning else "revolute"
        hang(f"j{i + 1}", kind, f"link{i + 1}", (xyz[i], rpy[i]), f'<axis xyz="{_text(axes[i])}"/>{limit}')
    hang("mount", "fixed", "tip", (xyz[joints], rpy[joints]))
    return "".join(parts) + "</robot>"


def _unit(rng: np.random.Generator) -> Array:
    v = rng.normal(size=3)
    return np.asarray(v / np.linalg.norm(v))


def _text(v: Array) -> str:
    return " ".join(repr(float(x)) for x in v)
