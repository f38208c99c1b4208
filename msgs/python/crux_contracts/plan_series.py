"""A plan's knots as arrays, for the plots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import gripper_wrench
from crux_msgs import limb_knot_t

N_LIMBS = len(LIMB_NAMES)


@dataclass(frozen=True)
class Swing:
    """One maximal run of AIR knots of a limb."""

    limb: int
    first: int  # k0: the gripper still stands in its old grasp, unloaded
    last: int  # k1: it closes on the new one
    from_hold: str
    to_hold: str


@dataclass(frozen=True)
class PlanSeries:
    """Knots k = 0..K-1; wrenches act on the robot, frame W, limbs LF, RF, LR, RR."""

    time_s: np.ndarray  # (K,)
    stance: np.ndarray  # (K, 4) bool
    hold: np.ndarray  # (K, 4) index into holds, -1 in the air
    on_wall: np.ndarray  # (K, 4) bool: a foot on the wall itself
    hold_names: list[str]
    body_position_m: np.ndarray  # (K, 3)
    body_rpy_rad: np.ndarray  # (K, 3)
    gripper_position_m: np.ndarray  # (K, 4, 3)
    gripper_yaw_rad: np.ndarray  # (K, 4)
    separation_m: np.ndarray  # (K, 4)
    finger_force_n: np.ndarray  # (K, 4, 2, 3)
    finger_moment_nm: np.ndarray  # (K, 4, 2, 3)
    wrench: np.ndarray  # (K, 4, 6) force and moment on the robot at the gripper's centre
    dt_s: float

    @property
    def opening_axis(self) -> np.ndarray:
        """e of every gripper, (K, 4, 3)."""
        return np.stack([np.cos(self.gripper_yaw_rad), np.sin(self.gripper_yaw_rad), 0 * self.gripper_yaw_rad], axis=-1)

    @property
    def force_n(self) -> np.ndarray:
        """F of every gripper, (K, 4, 3)."""
        return self.wrench[..., :3]

    @property
    def moment_nm(self) -> np.ndarray:
        """M of every gripper about its centre, (K, 4, 3)."""
        return self.wrench[..., 3:]

    def knot_at(self, plan_time_s: np.ndarray) -> np.ndarray:
        """The knot that begins the interval of each plan time, of the same shape."""
        knots = np.searchsorted(self.time_s, plan_time_s + 1e-9) - 1
        return np.asarray(np.clip(knots, 0, len(self.time_s) - 1))

    def swings(self) -> list[Swing]:
        """All swings in the order of their start."""
        found = []
        for limb in range(N_LIMBS):
            air = np.flatnonzero(~self.stance[:, limb])
            for run in np.split(air, np.flatnonzero(np.diff(air) > 1) + 1) if len(air) else []:
                before, after = max(run[0] - 1, 0), min(run[-1] + 1, len(self.time_s) - 1)
                names = [self.hold_name(int(self.hold[knot, limb])) for knot in (before, after)]
                found.append(Swing(limb, int(run[0]), int(run[-1]), *names))
        return sorted(found, key=lambda swing: (swing.first, swing.limb))

    def hold_name(self, index: int) -> str:
        """Name of a hold; '' for none."""
        return self.hold_names[index] if 0 <= index < len(self.hold_names) else ""


def plan_series(plan: Any) -> PlanSeries:
    """Arrays of a plan_t (or of the same message decoded from a log)."""
    knots = plan.knots
    limbs = [knot.limbs for knot in knots]

    def per_limb(name: str) -> np.ndarray:
        return np.array([[getattr(limb, name) for limb in row] for row in limbs])

    def fingers(name: str) -> np.ndarray:
        return per_limb(name).reshape(len(knots), N_LIMBS, 2, 3)

    return PlanSeries(
        time_s=np.array([knot.time_s for knot in knots]),
        stance=per_limb("phase") == limb_knot_t.STANCE,
        hold=per_limb("hold"),
        on_wall=per_limb("finger1_face") == limb_knot_t.FACE_WALL,
        hold_names=[hold.name for hold in plan.holds],
        body_position_m=np.array([list(knot.body_position_w_m) for knot in knots]),
        body_rpy_rad=np.array([list(knot.body_rpy_rad) for knot in knots]),
        gripper_position_m=per_limb("gripper_position_w_m"),
        gripper_yaw_rad=per_limb("gripper_yaw_w_rad"),
        separation_m=per_limb("finger_separation_m"),
        finger_force_n=fingers("finger_force_w_n"),
        finger_moment_nm=fingers("finger_moment_w_nm"),
        wrench=np.array([[gripper_wrench(limb) for limb in row] for row in limbs]),
        dt_s=plan.dt_s,
    )
