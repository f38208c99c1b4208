"""More load for the grips of a plan that is solved: what balances other accelerations, by the least change."""

from typing import Any

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.plan_file import plan_id
from crux_contracts.plan_series import PlanSeries, plan_series
from crux_msgs import plan_t

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import face_normals, touch_off_axis_m
from crux_planner.model.hands import TILTED
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.mass import centres_of_mass
from crux_planner.model.problem import Problem
from crux_planner.physics.limit_surface import finger_forces

_UNITS = np.array([[1, 0, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0.5, -0.5]], dtype=float)
_SQUEEZE = np.array([0.0, 0.0, 0.0, 1.0, 1.0])
_ROUNDS, _LACK = 20, 1e-9  # of more load, until no more than this lacks [N, N m]: squeezed pads turn on leaning faces


def bear_more(plan: plan_t, lack: Array, problem: Problem, squeeze_N: Array | None = None) -> None:
    """The plan with so much more force and moment about its centre of mass, `lack` (N, 6) in W, on the robot, in place:
    the least change, and fingers squeeze as much more as friction needs for it, and by `squeeze_N` (N, 4) besides. A
    foot bears what it does as a force alone.
    """
    loads = _Loads(plan, problem)
    for k, wrench in enumerate(lack):
        loads.change(k, wrench, np.zeros(4) if squeeze_N is None else squeeze_N[k])
    forces, moments = loads.forces, loads.moments
    forces[-1], moments[-1] = forces[-2], moments[-2]
    for k, limb in np.argwhere(loads.series.stance):
        grip = plan.knots[k].limbs[limb]
        grip.finger_force_w_n = forces[k, limb].ravel().tolist()
        grip.finger_moment_w_nm = moments[k, limb].ravel().tolist()
    plan.plan_id = plan_id(plan)


class _Loads:
    """Forces and moments (K, 4, 2, 3) of a plan's fingers in W, and the grips that they are changed by."""

    def __init__(self, plan: plan_t, problem: Problem) -> None:
        self.series, self.problem = plan_series(plan), problem
        series = self.series
        self.feet = series.stance & series.on_wall  # (K, 4)
        self.forces, self.moments = series.finger_force_n.copy(), series.finger_moment_nm.copy()
        self.turn = gripper_rotation(series.gripper_yaw_rad, series.gripper_tilt_rad)
        above_m = problem.shape.pad_radius * np.where(self.feet[..., None], self.turn[..., 2], 0.0)
        self.arm_m = series.gripper_position_m - _centres(series, series.gripper_position_m + above_m, problem)[:, None]
        leans = np.array([hold.lean_rad for hold in plan.holds])
        faces = np.where(self.feet, 0, series.finger1_face)
        self.lean_rad = np.stack([leans[series.hold, faces ^ side] for side in (0, 1)], axis=-1)
        self.lean_rad[~series.stance | self.feet] = 0.0

    def change(self, k: int, lack: Array, squeeze_N: Array) -> None:
        """By `lack` (6,) more force on the robot and moment about its centre of mass from a knot on, and by how much
        harder (4,) fingers squeeze.
        """
        held: list[int] = np.flatnonzero(self.series.stance[k]).tolist()
        for limb in np.flatnonzero(squeeze_N).tolist():
            if limb in held and not self.feet[k, limb]:
                lack = lack - self._add(k, limb, squeeze_N[limb] * _SQUEEZE)
        feet = self.feet[k]
        units = [self._of_forces(k, i, np.eye(3)) if feet[i] else self._effect(k, i, _UNITS) for i in held]
        least = np.linalg.pinv(np.concatenate(units).T)
        ends = np.cumsum([len(each) for each in units])
        for _ in range(_ROUNDS):
            if float(np.abs(lack).max()) <= _LACK:
                return
            for limb, more in zip(held, np.split(least @ lack, ends[:-1]), strict=True):
                if self.feet[k, limb]:
                    self.forces[k, limb] += more / 2
                    lack = lack - self._of_forces(k, limb, more)
                    continue
                shear, lift, twist, push = more
                squeeze = abs(push) / 2 + self._squeeze(k, limb, np.array([shear, lift, twist]))
                q = np.array([shear, lift, twist, squeeze + push / 2, squeeze - push / 2])
                lack = lack - self._add(k, limb, q)

    def _of_forces(self, k: int, limb: int, force_N: Array) -> Array:
        """(..., 6) as `_effect`, of forces (..., 3) in W at a foot point."""
        return np.concatenate([force_N, np.cross(self.arm_m[k, limb], force_N)], axis=-1)

    def _add(self, k: int, limb: int, q: Array) -> Array:
        """Adds q (5,) to what the fingers of a limb do; its effect."""
        forces, moments = self._fingers(k, limb, q)
        self.forces[k, limb] += forces
        self.moments[k, limb] += moments
        return self._effect(k, limb, q)

    def _squeeze(self, k: int, limb: int, load: Array) -> float:
        """How much harder fingers press for as much more shear, lift and twist (3,) of each; spines alone do not."""
        if self.series.friction[k, limb] <= 0.0:
            return 0.0
        friction = np.tan(np.arctan(self.series.friction[k, limb]) - np.abs(self.lean_rad[k, limb]).max())
        return float(np.linalg.norm([*load[:2], load[2] / self.problem.patch.k_m]) / friction)

    def _fingers(self, k: int, limb: int, q: Array) -> tuple[Array, Array]:
        """Forces and moments (..., 2, 3) of q (..., 5), see `finger_forces`."""
        axis, across, up = self.turn[k, limb].T
        leaning, lean = None, self.lean_rad[k, limb]
        if lean.any():
            normals = face_normals(axis, up, lean)
            leaning = normals, touch_off_axis_m(axis, normals, self.problem.shape.pad_radius)
        return finger_forces(q, axis, across, leaning, up)

    def _effect(self, k: int, limb: int, q: Array) -> Array:
        """(..., 6) force on the robot and moment about its centre of mass of q (..., 5)."""
        forces, moments = self._fingers(k, limb, q)
        arms = np.outer([0.5, -0.5], self.series.separation_m[k, limb] * self.turn[k, limb, :, 0])
        about = moments + np.cross(self.arm_m[k, limb] + arms, forces)
        return np.concatenate([forces.sum(axis=-2), about.sum(axis=-2)], axis=-1)


def _centres(series: PlanSeries, frames_m: Array, problem: Problem) -> Array:
    """(K, 3) of mass, in W, with the grippers' frames at (K, 4, 3)."""
    to_h = rotation_z(-problem.heading_rad)
    poses = np.hstack([series.body_position_m @ to_h.T, series.body_rpy_rad - [0.0, 0.0, problem.heading_rad]])
    hands: list[Any] = [frames_m @ to_h.T, series.gripper_yaw_rad[..., None] - problem.heading_rad]
    if problem.hand_numbers == TILTED:
        hands.append(series.gripper_tilt_rad @ to_h[:2, :2].T)
    return centres_of_mass(problem, poses, np.concatenate(hands, axis=2)) @ to_h
