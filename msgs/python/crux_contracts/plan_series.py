"""A plan's knots as arrays, and as a pandas data frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from crux_msgs import limb_knot_t, plan_t
from numpy.typing import NDArray

from . import LIMB_NAMES, N_LIMBS
from .gripper_frames import gripper_rotation
from .interpolation import gripper_wrench

if TYPE_CHECKING:
    import pandas

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
_COMPONENTS = {"body_rpy_rad": ("roll", "pitch", "yaw"), "wrench": ("fx", "fy", "fz", "mx", "my", "mz")}


@dataclass(frozen=True)
class Swing:
    """One maximal run of AIR knots of a limb."""

    limb: int
    first: int  # k0: the gripper still stands in its old grasp, unloaded
    last: int  # k1: it closes on the new one
    from_hold: str
    to_hold: str


@dataclass(frozen=True, eq=False, repr=False)
class PlanSeries:
    """A plan's knots k = 0..N as arrays, K = N + 1 rows; limbs LF, RF, LR, RR; fingers 1 and 2.

    Positions and directions are in the wall's frame W, forces and moments act on the robot. Between knots
    `crux_contracts.interpolation.PlanReference` says where everything is.
    """

    time_s: Floats
    """(K,) s"""
    stance: Flags
    """(K, 4) whether the limb holds on; else it is in the air"""
    hold: Indices
    """(K, 4) index into hold_names, -1 in the air and on the wall itself"""
    finger1_face: Indices
    """(K, 4) face under finger 1: +x, -x, +y, -y of its hold 0 to 3, the wall itself 4, -1 in the air"""
    friction: Floats
    """(K, 4) coefficient of the smoother face in contact, 0 in the air"""
    hold_names: list[str]
    """of holds, then obstacles"""
    body_position_m: Floats
    """(K, 3) m, origin of the body's frame B in W"""
    body_rpy_rad: Floats
    """(K, 3) rad, roll, pitch, yaw, intrinsic z-y-x: R turns W <- B"""
    body_velocity_m_s: Floats
    """(K, 3) m/s in W"""
    body_angular_velocity_b_rad_s: Floats
    """(K, 3) rad/s in B"""
    gripper_position_m: Floats
    """(K, 4, 3) m, midpoint of the finger pads in W"""
    gripper_yaw_rad: Floats
    """(K, 4) rad, of an upright gripper's opening axis about W's z, not wrapped"""
    gripper_tilt_rad: Floats
    """(K, 4, 2) rad, rotation vector about W's x and y that tilts the gripper then: R = exp(tilt) Rz(yaw)"""
    separation_m: Floats
    """(K, 4) m, pad face to pad face"""
    finger_force_n: Floats
    """(K, 4, 2, 3) N in W"""
    finger_moment_nm: Floats
    """(K, 4, 2, 3) N m in W, about each finger's contact point"""
    wrench: Floats
    """(K, 4, 6) N and N m in W: force, then moment about the gripper's centre, over [k, k+1)"""
    dt_s: float
    """s, between knots"""

    def __repr__(self) -> str:
        end_s = self.time_s[-1] if len(self.time_s) else 0.0
        swings = f"{len(self.swings())} swings, {len(self.hold_names)} holds and obstacles"
        return f"PlanSeries({len(self.time_s)} knots, 0 to {end_s:g} s, {swings})"

    @property
    def on_wall(self) -> Flags:
        """(K, 4): whether a foot stands on the wall itself."""
        return np.asarray(self.finger1_face == limb_knot_t.FACE_WALL)

    @property
    def opening_axis(self) -> Floats:
        """e of every gripper, (K, 4, 3)."""
        return gripper_rotation(self.gripper_yaw_rad, self.gripper_tilt_rad)[..., 0]

    @property
    def force_n(self) -> Floats:
        """F of every gripper, (K, 4, 3)."""
        return self.wrench[..., :3]

    @property
    def moment_nm(self) -> Floats:
        """M of every gripper about its centre, (K, 4, 3)."""
        return self.wrench[..., 3:]

    def knot_at(self, plan_time_s: Floats) -> Indices:
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

    def to_dataframe(self) -> pandas.DataFrame:
        """One row a knot, indexed by time_s: the columns are this class's arrays, split by limb, finger and component,
        such as body_position_m_x, LF_hold (its name, empty for none), LF_wrench_fx, LF_finger_force_n_1_x. Units and
        frames are those of the arrays. Raises ImportError, which says what to install, without pandas.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError("to_dataframe needs pandas, which crux does not: pip install pandas") from error
        columns: dict[str, np.ndarray] = {}
        for name, array in vars(self).items():
            if isinstance(array, np.ndarray) and name != "time_s":
                values = np.array([*self.hold_names, ""])[array] if name == "hold" else array
                columns |= _columns(name, values)
        return pd.DataFrame(columns, index=pd.Index(self.time_s, name="time_s"))


def _columns(name: str, array: np.ndarray) -> dict[str, np.ndarray]:
    """An array (K, ...) as columns (K,), each named by limb, array, finger and component."""
    axes: list[tuple[str, ...]] = [] if name.startswith("body") else [LIMB_NAMES]
    axes += [("1", "2")] if name.startswith("finger_") else []
    axes += [_COMPONENTS.get(name, ("x", "y", "z"))] if len(axes) < array.ndim - 1 else []
    columns = {}
    for place in np.ndindex(array.shape[1:]):
        words = [axis[i] for axis, i in zip(axes, place, strict=True)]
        words.insert(0 if name.startswith("body") else 1, name)
        columns["_".join(words)] = array[(slice(None), *place)]
    return columns


def plan_series(plan: plan_t) -> PlanSeries:
    """Arrays of a plan (or of the same message decoded from a log)."""
    knots = plan.knots
    limbs = [knot.limbs for knot in knots]

    def per_knot(name: str) -> Floats:
        return np.array([getattr(knot, name) for knot in knots], dtype=float)

    def per_limb(name: str) -> np.ndarray:
        return np.array([[getattr(limb, name) for limb in row] for row in limbs])

    def fingers(name: str) -> Floats:
        return per_limb(name).reshape(len(knots), N_LIMBS, 2, 3)

    return PlanSeries(
        time_s=per_knot("time_s"),
        stance=per_limb("phase") == limb_knot_t.STANCE,
        hold=per_limb("hold"),
        finger1_face=per_limb("finger1_face"),
        friction=per_limb("friction"),
        hold_names=[hold.name for hold in plan.holds],
        body_position_m=per_knot("body_position_w_m"),
        body_rpy_rad=per_knot("body_rpy_rad"),
        body_velocity_m_s=per_knot("body_velocity_w_m_s"),
        body_angular_velocity_b_rad_s=per_knot("body_angular_velocity_b_rad_s"),
        gripper_position_m=per_limb("gripper_position_w_m"),
        gripper_yaw_rad=per_limb("gripper_yaw_w_rad"),
        gripper_tilt_rad=per_limb("gripper_tilt_w_rad"),
        separation_m=per_limb("finger_separation_m"),
        finger_force_n=fingers("finger_force_w_n"),
        finger_moment_nm=fingers("finger_moment_w_nm"),
        wrench=np.array([[gripper_wrench(limb) for limb in row] for row in limbs]),
        dt_s=plan.dt_s,
    )
