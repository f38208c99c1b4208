"""A robot at any posture of its joints: what it looks like, where its links meet, and what its joints bear."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from crux_planner.checker.limb_model import Link
from crux_planner.method_report import upright_reach
from scipy.spatial.transform import Rotation

from crux_tools.errors import UsageError
from crux_tools.robot.described import Described
from crux_tools.robot.loads import joint_loads, peak_torques_Nm
from crux_tools.robot.stance import CLEAR_M, Stance, limb_reach, meetings, stance, standing
from crux_tools.view.bodies import Shape, numbers
from crux_tools.view.meshes import drawn_mesh, meshes_of
from crux_tools.view.robot.surface import surface

DRAWN, COLLIDES, BOTH = "drawn", "collides", "both"  # the layers of a shape


class Figure:
    """One robot. Its bodies are the body's link, then all links of its limbs. Frame: the body's."""

    def __init__(self, robot: Described, friction: float) -> None:
        """Raises UsageError where it has no chains of joints to be drawn."""
        if robot.model is None:
            raise UsageError(f"{robot.files.folder}: no joints to show: {robot.unclear}; crux robot check says more")
        self._described, self.model, self._friction = robot, robot.model, friction
        self._links = [self.model.body, *(link for limb in self.model.limbs for link in limb.links)]
        self._number = {link.name: i for i, link in enumerate(self._links)}
        self._peaks = peak_torques_Nm(self.model.limbs)
        sections = robot.sections
        reaches = [limb_reach(self.model.body, limb, sections) for limb in self.model.limbs]
        self._ends = [
            np.array([np.where(np.isfinite(limb.lower_rad), limb.lower_rad, -math.pi),
                      np.where(np.isfinite(limb.upper_rad), limb.upper_rad, math.pi)])
            for limb in self.model.limbs
        ]  # fmt: skip
        self._start = [ends.mean(axis=0) for ends in self._ends]
        if all(len(reach.places_m) for reach in reaches):
            self._start = stance(self.model, reaches, sections["gripper"].open_opening_m).q_rad
        self._height_m = sum(sections["body"].height_m) / 2

    def told(self) -> dict[str, Any]:
        """What does not change: shapes, joints by limb, frames, and the stance in the middle of what limbs reach."""
        gripper = self._described.sections["gripper"]
        frames = {self.model.body.name: 0}
        for limb in self.model.limbs:
            frames |= {joint.name: self._number[joint.child] for joint in limb.joints}
            frames[limb.gripper] = self._number[limb.gripper]
        return {
            "name": self._described.files.keys.top["name"],
            "shapes": self._shapes(),
            "limbs": [self._limb(i) for i in range(len(self.model.limbs))],
            "frames": frames,
            "heightM": self._height_m,
            "openingM": [*map(float, gripper.opening_m), float(gripper.open_opening_m)],
            "planned": self._described.robot is not None,
        }

    def _limb(self, index: int) -> dict[str, Any]:
        limb, (low, high) = self.model.limbs[index], self._ends[index]
        joints = [
            {"name": joint.name, "low": float(low[i]), "high": float(high[i]),
             "start": float(self._start[index][i]), "body": self._number[joint.child]}
            for i, joint in enumerate(limb.joints)
        ]  # fmt: skip
        return {"name": limb.name, "joints": joints, "gripper": self._number[limb.gripper]}

    def _shapes(self) -> list[Shape]:
        robot = self._described.robot
        meshes = (
            {}
            if robot is None
            else {name: [drawn_mesh(each) for each in found] for name, found in meshes_of(robot).items()}
        )
        limb_of = {link.name: i for i, limb in enumerate(self.model.limbs) for link in limb.links}
        found: list[Shape] = []
        for body, link in enumerate(self._links):
            own = {"body": body, "limb": limb_of.get(link.name, -1)}
            found += [{**mesh, **own, "layer": DRAWN} for mesh in meshes.get(link.name, [])]
            layer = COLLIDES if link.name in meshes else BOTH
            found += [{**shape, **own, "layer": layer} for shape in _shapes_of(link)]
        return found

    def at(self, q_rad: list[list[float]], opening_m: float, slope_deg: float, lifted: int | None) -> dict[str, Any]:
        """At joint angles by limb: poses of bodies, grippers, links that meet, and loads on a wall of this slope with
        limb number `lifted` in the air. Raises ValueError for what is no posture.
        """
        limbs = self.model.limbs
        angles = [np.array(q, dtype=float) for q in q_rad]
        if [q.shape for q in angles] != [(len(limb.joints),) for limb in limbs]:
            raise ValueError(f"q_rad: expected lists of {[len(limb.joints) for limb in limbs]} angles")
        if not all(np.isfinite([*np.concatenate(angles), opening_m, slope_deg])):
            raise ValueError("expected numbers")
        if lifted not in (None, *range(len(limbs))):
            raise ValueError(f"lifted: {lifted}; expected null or a limb's number")
        where = standing(self.model, angles, opening_m)
        return {
            "poses": self._poses(where),
            "grippers": [_gripper(*where.gripper(i)) for i in range(len(limbs))],
            "meets": [
                {"links": each.links, "bodies": [self._number[link] for link in each.links], "gapM": each.gap_m}
                for each in meetings(where, CLEAR_M)
            ],
            "loads": self._loads(where, math.radians(slope_deg), lifted),
        }

    def _poses(self, where: Stance) -> list[float]:
        """Of bodies: x, y, z, then w, x, y, z, each."""
        place, turn = [np.zeros(3)], [np.eye(3)]
        for limb, state in zip(self.model.limbs, where.states, strict=True):
            place += [state.link_position_m[link.name][0] for link in limb.links]
            turn += [state.link_rotation[link.name][0] for link in limb.links]
        xyzw = Rotation.from_matrix(np.array(turn)).as_quat()
        return numbers(np.hstack([np.array(place), xyzw[:, [3, 0, 1, 2]]]))

    def _loads(self, where: Stance, slope_rad: float, lifted: int | None) -> dict[str, Any]:
        """Shares of peak torques by limb, and the busiest joint; or why there are none."""
        names = [joint.name for limb in self.model.limbs for joint in limb.joints]
        peaks = np.concatenate(self._peaks)
        if weak := [name for name, peak in zip(names, peaks, strict=True) if not 0 < peak < np.inf]:
            return {"why": f"no peak torque: {', '.join(weak)}"}
        for limb, state in zip(self.model.limbs, where.states, strict=True):
            if limb.actuators is not None and not limb.actuators.keeps(state.q_rad).all():
                return {"why": f"{limb.name}: an actuator is beyond its limits, or a five-bar too near to singular"}
        most_N = self._described.sections["gripper"].max_finger_force_N
        found = joint_loads(where, slope_rad, self._peaks, self._friction, most_N, lifted)
        if found is None:
            return {"why": f"slips: with friction {self._friction:g} no forces of these grips hold the robot"}
        shares = [np.abs(each).round(4).tolist() for each in found.shares]
        return {"share": found.load.share, "joint": found.load.joint, "shares": shares}

    def reach(self, limb: int) -> dict[str, Any]:
        """Where the limb can have its gripper upright, as corners and triangles in one list each. Raises ValueError."""
        robot = self._described.robot
        if robot is None or not 0 <= limb < len(self.model.limbs):
            raise ValueError("no such limb of a robot that the planner takes")
        cells = upright_reach(robot, limb)
        corners, triangles = surface(cells.held, cells.first_m, cells.step_m)
        return {"corners": numbers(corners), "triangles": triangles.ravel().tolist()}


def _gripper(place_m: np.ndarray, turn: np.ndarray) -> dict[str, Any]:
    tilt = math.degrees(math.acos(min(1.0, max(-1.0, float(turn[2, 2])))))
    return {"positionM": numbers(place_m), "tiltDeg": tilt, "yawDeg": math.degrees(math.atan2(turn[1, 0], turn[0, 0]))}


def _shapes_of(link: Link) -> list[Shape]:
    """Capsules and boxes, as crux keeps them apart; `size` is what a shape measures along its own axes."""
    found: list[tuple[str, Any, np.ndarray, Rotation]] = []
    for capsule in link.capsules:
        way = capsule.end_m - capsule.start_m
        length, width = float(np.linalg.norm(way)), 2 * capsule.radius_m
        turn = Rotation.align_vectors([way], [[0.0, 0.0, 1.0]])[0] if length > 0 else Rotation.identity()
        middle = (capsule.start_m + capsule.end_m) / 2
        found += [("sphere", [width] * 3, end, turn) for end in (capsule.start_m, capsule.end_m)]
        found.append(("cylinder", [width, width, length], middle, turn))
    for box in link.boxes:
        found.append(("box", 2 * box.half_m, box.centre_m, Rotation.from_matrix(box.rotation)))
    return [
        {"kind": kind, "size": numbers(size), "position": numbers(at), "wxyz": numbers(turn.as_quat()[[3, 0, 1, 2]])}
        for kind, size, at, turn in found
    ]
