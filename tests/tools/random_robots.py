"""Whole robots made up at random: four unlike limbs of the families of random_limbs, each hung on the trunk as its
maker would, so that it grips the wall beside the robot from a posture in the middle of its joint limits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import ROBOTS
from crux_contracts.robot_types import AtZero
from crux_contracts.urdf import about, roll_pitch_yaw, rotation
from crux_planner.model.arrays import Indices
from crux_planner.model.chain import Placed, forward, pose_error
from random_limbs import FAMILIES, Array, drawn

JOINTS = 6
TRIED, MOST, LOOKED_AT = 8000, 200, 50  # postures of a limb, how many are hung on the trunk, and looked at closely
MIDDLE_M, GRIP_M = 0.1875, 0.035  # heights of the body's origin and of a grip above the wall
LENGTH_M = (0.28, 0.5)  # of a limb stretched, up to its last joint
RANGE_RAD = (1.4, 2.0)  # of a joint to either side of its middle
HAND_M = 0.12  # of the gripper from the last joint, about
FASTEST_RAD_M = 16.0  # that a joint may turn for a metre of the gripper, where the limb grips and lifts
MASSES_KG = np.array([0.35, 0.35, 0.3, 0.15, 0.1, 0.1])
EFFORTS_NM = (12, 12, 12, 12, 12, 12)
GAINS = {
    "position_gain_Nm_rad": [60, 60, 60, 40, 40, 40],
    "velocity_gain_Nms_rad": [1.0, 1.0, 1.0, 0.45, 0.45, 0.45],
}
GYRATION_M = 0.03
TRUNK_M = np.array([0.15, 0.11, 0.03])  # half edges
CLEAR_M, LOW_M = 0.03, 0.08  # of the joints, off the trunk and above the wall
PALM = '<box size="0.14 0.024 0.02"/>'


@dataclass(frozen=True)
class _Chain:
    """Of J joints: axes (J, 3); places [m] and turns of joints and gripper (J + 1, ...), each in the one before."""

    axes: Array
    xyz_m: Array
    turns: Array

    def at_zero(self) -> AtZero:
        """In the frame that it hangs in."""
        place, turn, places, turns = np.zeros(3), np.eye(3), [], []
        for xyz, own in zip(self.xyz_m, self.turns, strict=True):
            place, turn = place + turn @ xyz, turn @ own
            places.append(place)
            turns.append(turn)
        axes = np.array([at @ axis for at, axis in zip(turns, self.axes, strict=False)])
        return AtZero(axes, np.array(places[:-1]), np.array(turns[:-1]), places[-1], turns[-1])


@dataclass(frozen=True)
class _Wanted:
    """Where a limb starts and where it grips in the middle of its joint limits, in the body frame; signs of x and y."""

    shoulder_m: Array
    gripper_m: Array
    turn: Array
    last_m: Array
    sides: Array


def robot_folder(seed: int, folder: Path) -> Path:
    """A robot's folder `random-SEED` in `folder`; its robot.yaml is the shipped robot's."""
    rng, name = np.random.default_rng(seed), f"random-{seed}"
    parts = [f'<robot name="{name}">', _link("base", 2.8, np.zeros(3), f'<box size="{_text(2 * TRUNK_M)}"/>')]
    for limb in LIMB_NAMES:
        chain, home_rad = _limb(limb, rng)
        parts += _urdf(limb, chain, home_rad, rng)
    made = folder / name
    made.mkdir(parents=True)
    (made / f"{name}.urdf").write_text("\n".join(parts) + "\n</robot>\n", encoding="utf-8")
    text = (ROBOTS / "scaler" / "robot.yaml").read_text(encoding="utf-8")
    for key, value in {"name": name, "urdf": f"{name}.urdf", **GAINS}.items():
        text, count = re.subn(rf"(?m)^( *){key}: .*$", rf"\1{key}: {value}", text)
        assert count == 1
    (made / "robot.yaml").write_text(text, encoding="utf-8")
    return made


def _limb(name: str, rng: np.random.Generator) -> tuple[_Chain, Array]:
    """Of the first draw that can be hung on the trunk so that it steps beside it, and the middle of its limits."""
    sides = np.array([1.0 if name[1] == "F" else -1.0, 1.0 if name[0] == "L" else -1.0, 1.0])
    while True:
        shoulder = sides * [rng.uniform(0.10, 0.14), rng.uniform(0.12, 0.15), rng.uniform(-0.01, 0.03)]
        gripper = sides * [rng.uniform(0.11, 0.17), rng.uniform(0.33, 0.40), 1.0]
        gripper[2] = GRIP_M - MIDDLE_M
        last = gripper + np.array([*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.10, 0.13)])
        turn = rotation((0.0, 0.0, rng.uniform(-0.4, 0.4)))
        axes, xyz, rpy = drawn(str(rng.choice(FAMILIES)), JOINTS, rng)
        turns = [rotation((float(r[0]), float(r[1]), float(r[2]))) for r in rpy]
        made = _hung(
            _Chain(np.array(axes), np.array(xyz), np.array(turns)), _Wanted(shoulder, gripper, turn, last, sides), rng
        )
        if made is not None:
            return made


def _hung(drawn_chain: _Chain, wanted: _Wanted, rng: np.random.Generator) -> tuple[_Chain, Array] | None:
    """The chain in the size, at the angles and with the mounts that suit best; None where none of those tried do."""
    axes, xyz, turns = drawn_chain.axes, drawn_chain.xyz_m.copy(), drawn_chain.turns.copy()
    xyz[0], turns[0] = 0.0, np.eye(3)
    q = rng.uniform(-np.pi, np.pi, (TRIED, JOINTS))
    there = forward(_Chain(axes, xyz, turns).at_zero(), q)
    points = there.points_m.transpose(2, 0, 1)
    far = np.linalg.norm(points[:, -1], axis=1)
    way = wanted.last_m - wanted.shoulder_m
    size = np.linalg.norm(way) / far
    stretched = size * np.linalg.norm(xyz[:JOINTS], axis=1).sum()
    some = np.flatnonzero((stretched > LENGTH_M[0]) & (stretched < LENGTH_M[1]))
    if not len(some):
        return None
    some = some[np.argsort(-_nimbleness(there, size, some))][:MOST]
    hang = _facing(points[some, -1] / far[some, None], way / np.linalg.norm(way), rng)
    placed = wanted.shoulder_m + np.einsum("n,nij,nkj->nki", size[some], hang, points[some])
    best, found = FASTEST_RAD_M, None
    for number in np.flatnonzero(_is_free(placed, wanted.sides))[:LOOKED_AT]:
        i = some[number]
        home = rng.uniform(-1.0, 1.0, JOINTS)
        own = [about(axis, angle) for axis, angle in zip(axes, q[i] - home, strict=True)]
        sized, at = size[i] * xyz, np.array([*(turns[:JOINTS] @ own), np.eye(3)])
        sized[0], at[0], sized[JOINTS] = wanted.shoulder_m, hang[number] @ at[0], 0.0
        back = forward(_Chain(axes, sized, at).at_zero(), home[None]).turns[-1][..., 0]
        zero = _Chain(axes, sized, at).at_zero()
        back = (back @ zero.rotations[-1]).T
        sized[JOINTS], at[JOINTS] = back @ (wanted.gripper_m - wanted.last_m), back @ wanted.turn
        chain = _Chain(axes, sized, at)
        fastest = _fastest(chain, home, wanted)
        if fastest < best:
            best, found = fastest, (chain, home)
    return found


def _nimbleness(there: Placed, size: Array, some: Indices) -> Array:
    """(n,) how far from singular some of the postures are: the least singular value, with lengths over HAND_M."""
    hand = there.points_m[-1] + HAND_M * there.turns[-1][:, 2]  # any place off the last joint
    arm = hand - there.points_m
    linear = np.cross(there.axes, arm, axis=1)[..., some] * size[some] / HAND_M
    slopes = np.concatenate([linear, there.axes[..., some]], axis=1)
    return np.asarray(np.linalg.svd(slopes.transpose(2, 1, 0), compute_uv=False)[:, -1])


def _facing(ways: Array, to: Array, rng: np.random.Generator) -> Array:
    """Rotations (n, 3, 3) that take unit vectors (n, 3) to another, turned about it at random."""
    found = []
    for way in ways:
        axis = np.cross(way, to)
        sine = np.linalg.norm(axis)
        turn = about(axis / sine, float(np.arctan2(sine, way @ to)))
        found.append(about(to, float(rng.uniform(-np.pi, np.pi))) @ turn)
    return np.array(found)


def _is_free(places: Array, sides: Array) -> Array:
    """Whether joints (n, J, 3) but the first are off wall and trunk and on their own side of the body."""
    off = (np.abs(places[:, 1:]) - TRUNK_M).max(axis=2) > CLEAR_M
    beside = (places * sides)[..., :2] > 0.06
    return np.asarray((off & beside[:, 1:].all(axis=2) & (places[:, 1:, 2] > LOW_M - MIDDLE_M)).all(axis=1))


def _fastest(chain: _Chain, home_rad: Array, wanted: _Wanted) -> float:
    """Of grips about the first one, all over a step and a lift: what a joint turns there at most for a metre of the
    gripper; infinite where the limb does not have all of them within its limits on its way there.
    """
    zero, grid = chain.at_zero(), np.meshgrid([-0.08, 0.0, 0.08], [-0.03, 0.03], [-0.01, 0.06], indexing="ij")
    off = np.stack([each.ravel() for each in grid])
    q = np.tile(home_rad, (off.shape[1], 1))
    turn = np.broadcast_to(wanted.turn[..., None], (3, 3, off.shape[1]))
    most = 0.0
    for share in np.linspace(0.25, 1.0, 4):
        for _ in range(3):
            here = forward(zero, q)
            error = pose_error(here, wanted.gripper_m[:, None] + share * off, turn)
            back = np.linalg.inv(here.jacobian() + 1e-9 * np.eye(6))
            q = q + (back @ error.T[..., None])[..., 0]
        if np.abs(error).max() > 1e-3 or np.abs(q - home_rad).max() > RANGE_RAD[0] - 0.15:
            return np.inf
        most = max(most, float(np.abs(back[..., :3]).max()))
        if most > FASTEST_RAD_M:
            return np.inf
    return most


def _urdf(limb: str, chain: _Chain, home_rad: Array, rng: np.random.Generator) -> Iterator[str]:
    """Its links and joints; now and then a joint is behind a fixed one."""
    radius, parent = rng.uniform(0.012, 0.02), "base"
    masses = rng.uniform(0.7, 1.3, JOINTS) * MASSES_KG
    for i, effort in enumerate(EFFORTS_NM):
        place, turn, name = chain.xyz_m[i], chain.turns[i], f"{limb}_link{i + 1}"
        if rng.random() < 0.3:
            seam, seam_turn = rng.uniform(-0.05, 0.05, 3), rotation((0.3, *rng.uniform(-3.0, 3.0, 2)))
            yield f'<link name="{limb}_plate{i}"/>'
            yield _joint(f"{limb}_seam{i}", "fixed", (parent, f"{limb}_plate{i}"), seam, seam_turn)
            parent, place, turn = f"{limb}_plate{i}", seam_turn.T @ (place - seam), seam_turn.T @ turn
        low, high = home_rad[i] - rng.uniform(*RANGE_RAD), home_rad[i] + rng.uniform(*RANGE_RAD)
        limit = f'<limit lower="{low:.6f}" upper="{high:.6f}" effort="{effort:g}" velocity="4.8"/>'
        axis = f'<axis xyz="{_text(chain.axes[i])}"/>{limit}'
        yield _joint(f"{limb}_joint{i + 1}", "revolute", (parent, name), place, turn, axis)
        ahead = chain.xyz_m[i + 1]
        if i == JOINTS - 1:
            ahead = ahead + 0.07 * chain.turns[i + 1][:, 2]  # up to the palm
        yield _link(name, float(masses[i]), ahead / 2, _capsule(ahead, radius))
        parent = name
    gripper = f"{limb}_gripper"
    yield _joint(f"{limb}_mount", "fixed", (parent, gripper), chain.xyz_m[JOINTS], chain.turns[JOINTS])
    yield _link(gripper, 0.25, np.array([0.0, 0.0, 0.06]), PALM, np.array([0.0, 0.0, 0.055]))
    for number, sign in ((1, 1.0), (2, -1.0)):
        finger, com = f"{limb}_finger{number}", np.array([sign * 0.012, 0.0, 0.025])
        limit = '<limit lower="0.008" upper="0.066" effort="60" velocity="0.02"/>'
        axis = f'<axis xyz="{sign:g} 0 0"/>{limit}'
        yield _joint(f"{finger}_slide", "prismatic", (gripper, finger), np.zeros(3), np.eye(3), axis)
        yield _link(finger, 0.05, com, '<cylinder radius="0.008" length="0.05"/>', com)


def _joint(name: str, kind: str, links: tuple[str, str], xyz: Array, turn: Array, more: str = "") -> str:
    ends = f'<parent link="{links[0]}"/><child link="{links[1]}"/>'
    origin = f'<origin xyz="{_text(xyz)}" rpy="{_text(roll_pitch_yaw(turn))}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{origin}{more}</joint>'


def _link(name: str, mass_kg: float, com: Array, solid: str, at: Array | None = None) -> str:
    """A solid with its own origin, or at a place."""
    own = 'ixx="{0}" ixy="0" ixz="0" iyy="{0}" iyz="0" izz="{0}"'.format(mass_kg * GYRATION_M**2)
    inertial = f'<inertial><origin xyz="{_text(com)}"/><mass value="{mass_kg:.6f}"/><inertia {own}/></inertial>'
    origin = "" if at is None else f'<origin xyz="{_text(at)}"/>'
    shape = f"<visual>{origin}{solid if '<geometry' in solid else f'<geometry>{solid}</geometry>'}</visual>"
    return f'<link name="{name}">{inertial}{shape if solid else ""}</link>'


def _capsule(way: Array, radius: float) -> str:
    """From a link's frame to a place; a ball where that is near."""
    length = float(np.linalg.norm(way))
    if length < radius:
        return f'<geometry><sphere radius="{radius:.6f}"/></geometry>'
    turn = (0.0, float(np.arctan2(np.hypot(way[0], way[1]), way[2])), float(np.arctan2(way[1], way[0])))
    solid = f'<capsule radius="{radius:.6f}" length="{length:.6f}"/>'
    return f'<origin xyz="{_text(way / 2)}" rpy="{_text(turn)}"/><geometry>{solid}</geometry>'


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(v)) for v in values)
