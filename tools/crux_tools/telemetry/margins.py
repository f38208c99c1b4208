"""How far each finger is from slipping, by the limit surface the checker uses.

For a plan the fingers' wrenches are known. A log holds the wrench of the gripper and the squeeze of its actuator; the
two fingers' shares follow from them: one actuator drives both, so the squeeze is the mean of the two normal forces and
the wrench's part along the opening axis their difference; the fingers share tangential force and twist equally (4);
what is left of the moment, across the opening axis, is a couple of tangential forces on the arm between the pads.
On a face that leans a pad, a ball, touches beside the axis, and its twist is about the face's normal.
A foot on the wall itself stands on both pads alike, and bears no moment (msgs/PLAN.md).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.plan_series import PlanSeries, plan_series
from crux_contracts.robot import load_robot, robot_names
from crux_planner.checker.limit_surface import cone_excess

from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.lag import lagged
from crux_tools.telemetry.rotations import rotations_from_quaternions
from crux_tools.telemetry.summary import in_full_stance
from crux_tools.telemetry.surfaces import pad_shares_of

_FACES = 4  # +x, -x, +y, -y
X, Y, Z = np.eye(3)
_ALONG = 0.9  # of a unit vector, along X: it is too near to it for a vector across
SIDES = np.array([[1.0], [-1.0]])  # of the opening axis, fingers 1 and 2


class _Surfaces(NamedTuple):
    """Under fingers 1 and 2 at every knot, (K, 4, 2) each: friction, what spines grip, what of the pad bears."""

    friction: np.ndarray
    spines: np.ndarray
    share: np.ndarray

    def at(self, knot: Any) -> _Surfaces:
        return _Surfaces(*(values[knot] for values in self))


def _surfaces(plan: Any, series: PlanSeries) -> _Surfaces:
    friction, spines = np.zeros((*series.hold.shape, 2)), np.zeros((*series.hold.shape, 2))
    share, shares = np.ones((*series.hold.shape, 2)), pad_shares_of(plan)
    for k, knot in enumerate(plan.knots):
        for index, limb in enumerate(knot.limbs):
            if series.stance[k, index] and 0 <= limb.hold < len(plan.holds) and 0 <= limb.finger1_face < _FACES:
                hold = plan.holds[limb.hold]
                faces = (limb.finger1_face, limb.finger1_face ^ 1)
                friction[k, index] = [hold.friction[face] for face in faces]
                share[k, index] = [shares[limb.hold][face] for face in faces]
                spines[k, index] = share[k, index] * [bool(hold.spines[face]) for face in faces]
            elif series.stance[k, index]:
                friction[k, index] = limb.friction
                spines[k, index] = float(limb.hold < 0)  # none grip at footholds
    return _Surfaces(friction, spines, share)


class Grip(NamedTuple):
    """How near fingers are to slipping; both NaN where they do not grip."""

    margin_n: np.ndarray
    """mu fz - demand of the limit surface (1)-(3), after the micro-spines' share"""
    used: np.ndarray
    """demand / (mu fz): 0 unloaded, 1 on the limit surface, beyond it slips; inf without normal force"""

    def limbs(self) -> Grip:
        """Of a limb's two fingers, the last axis, the one that is nearer to slipping by each."""
        return Grip(self.margin_n.min(axis=-1), self.used.max(axis=-1))

    def where(self, gripping: np.ndarray) -> Grip:
        """NaN elsewhere."""
        return Grip(*(np.where(gripping, values, np.nan) for values in self))


def _grip(
    plan: Any,
    force: np.ndarray,
    moment: np.ndarray,
    outward: np.ndarray,
    up: np.ndarray,
    on_wall: np.ndarray,
    on: _Surfaces,
) -> Grip:
    """Of wrenches (..., 2, 3), (..., 2, 3) on faces with outward normals (..., 2, 3) by grippers whose z is `up`
    (..., 3), or on the wall itself (...): spines hold along the ways of the gripper.
    """
    across = np.where(np.abs(outward[..., :1]) < _ALONG, X, Y)
    along_wall = across - (across * outward).sum(axis=-1, keepdims=True) * outward
    tangent = np.where(on_wall[..., None, None], along_wall, np.cross(up[..., None, :], outward))
    tangent = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    other_tangent = np.cross(outward, tangent)
    normal = (force * outward).sum(axis=-1)
    margin = -cone_excess(
        np.stack([(force * tangent).sum(axis=-1), (force * other_tangent).sum(axis=-1)], axis=-1),
        (moment * outward).sum(axis=-1),
        normal,
        friction=on.friction,
        patch_k_m=plan.patch_k_m * on.share,
        spine_shear_N=plan.spine_shear_n * on.spines,
        spine_twist_Nm=plan.spine_twist_nm * on.spines,
    )
    most = on.friction * np.maximum(normal, 0.0)
    return Grip(margin, np.divide(most - margin, most, out=np.full_like(margin, np.inf), where=most > 0))


def _outward(axis: np.ndarray, up: np.ndarray, on_wall: np.ndarray) -> np.ndarray:
    """Normals under fingers 1 and 2 (..., 4, 2, 3): along the opening axis on a hold, `up` of the plan's gripper on the
    wall.
    """
    return np.where(on_wall[..., None, None], up[..., None, :], np.stack([axis, -axis], axis=-2))


class _Leaning(NamedTuple):
    """Of fingers 1 and 2 at every knot, (K, 4, 2, 3) each."""

    normal: np.ndarray
    touch_m: np.ndarray
    """where the pads touch, off their faces on the opening axis"""

    @classmethod
    def of(cls, plan: Any, series: PlanSeries, outward: np.ndarray) -> _Leaning | None:
        """None where no face leans."""
        lean = np.zeros((*series.hold.shape, 2))
        for k, limb in np.argwhere(series.stance & (series.hold >= 0) & ~series.on_wall).tolist():
            face, hold = series.finger1_face[k, limb], plan.holds[series.hold[k, limb]]
            lean[k, limb] = [hold.lean_rad[face], hold.lean_rad[face ^ 1]]
        if not lean.any():
            return None
        normal = np.cos(lean)[..., None] * outward + np.sin(lean)[..., None] * Z  # feet lean by nothing
        radius_m = load_robot(plan.robot_name).gripper.pad_radius_m if plan.robot_name in robot_names() else 0.0
        return cls(normal, radius_m * (outward - normal))

    def at(self, knot: Any) -> _Leaning:
        return _Leaning(self.normal[knot], self.touch_m[knot])

    def split(
        self, force: np.ndarray, moment: np.ndarray, axis: np.ndarray, half_m: np.ndarray, squeeze_n: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """As split_between_fingers, about where the pads touch."""
        moment = moment - np.cross(self.touch_m.mean(axis=-2), force)
        couple = np.cross(self.touch_m[..., 0, :] - self.touch_m[..., 1, :], axis)
        forces, _ = split_between_fingers(force, moment - squeeze_n[..., None] * couple, axis, half_m, squeeze_n)
        cosines = ((self.normal[..., 0, :] - self.normal[..., 1, :]) * axis).sum(axis=-1)
        twist = (moment * axis).sum(axis=-1) / cosines
        return forces, twist[..., None, None] * self.normal * SIDES


def planned_margin_n(plan: Any) -> np.ndarray:
    """Margin of fingers 1 and 2 of every limb at every knot, (K, 4, 2) [N]; NaN in the air."""
    return planned_grip(plan).margin_n


def planned_grip(plan: Any) -> Grip:
    """Of fingers 1 and 2 of every limb at every knot, (K, 4, 2); NaN in the air."""
    series = plan_series(plan)
    axis = series.opening_axis
    up = gripper_rotation(series.gripper_yaw_rad, series.gripper_tilt_rad)[..., 2]
    outward = _outward(axis, up, series.on_wall)
    moment, leaning = series.finger_moment_nm, _Leaning.of(plan, series, outward)
    if leaning is not None:
        outward, moment = leaning.normal, moment - np.cross(leaning.touch_m, series.finger_force_n)
    grip = _grip(plan, series.finger_force_n, moment, outward, up, series.on_wall, _surfaces(plan, series))
    return grip.where(series.stance[..., None])


def split_between_fingers(
    force: np.ndarray, moment: np.ndarray, axis: np.ndarray, half_opening_m: np.ndarray, squeeze_n: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Forces and moments (..., 2, 3) of fingers 1 (at +axis) and 2 from a gripper's wrench and actuator's squeeze."""
    along = (force * axis).sum(axis=-1, keepdims=True)
    tangential = force - along * axis
    twist = (moment * axis).sum(axis=-1, keepdims=True) * axis
    couple = np.cross(moment - twist, axis) / (2 * half_opening_m[..., None])
    first = tangential / 2 + couple + (squeeze_n[..., None] + along / 2) * axis
    second = tangential / 2 - couple - (squeeze_n[..., None] - along / 2) * axis
    return np.stack([first, second], axis=-2), np.stack([twist / 2, twist / 2], axis=-2)


def _gripper_wrenches(log: Telemetry, filter_s: float, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Measured forces and moments in W of every cycle, (n, 4, 3) each. The runtime logs them now and then; from there
    they move on by what the raw reading, logged every cycle, has changed since behind the runtime's filter."""
    n = len(log.time_s)
    rows = np.arange(n)
    raw = np.stack([log.inputs[name].reshape(n, 4, 3) for name in ("ft_force_g_n", "ft_moment_g_nm")], axis=2)
    good = (log.inputs["ft_fresh"] != 0) & (log.inputs["ft_status"] == 0) & np.isfinite(raw).all(axis=(2, 3))
    newest = np.maximum.accumulate(np.where(good, rows[:, None], 0), axis=0)
    raw = np.nan_to_num(raw)[newest, np.arange(4)]
    gain = float(log.inputs["dt_s"][0]) / (filter_s + float(log.inputs["dt_s"][0]))
    smooth = lagged(gain, raw, before=raw[0])
    logged = np.maximum.accumulate(np.where(log.limbs_fresh, rows, 0))
    change = np.einsum("nlij,nlqj->nlqi", rotation, smooth - smooth[logged])
    return log.limbs["force_w_n"] + change[:, :, 0], log.limbs["moment_w_nm"] + change[:, :, 1]


def measured_margin_n(log: Telemetry, filter_s: float) -> np.ndarray:
    """Margin of `measured_grip`, (n, 4, 2) [N]."""
    return measured_grip(log, filter_s).margin_n


def measured_grip(log: Telemetry, filter_s: float) -> Grip:
    """Of fingers 1 and 2 of every limb in every cycle, (n, 4, 2), with the squeeze measured in that cycle.

    NaN unless climbing in full stance. The faces are those of the plan's knot at the logged plan time. `filter_s`: time
    constant of the runtime's filter of the F/T reading.
    """
    plan = log.plan
    series = plan_series(plan)
    knot = series.knot_at(log.state["plan_time_s"])
    rotation = rotations_from_quaternions(log.limbs["gripper_quaternion_w"].reshape(-1, 4)).reshape(-1, 4, 3, 3)
    axis = rotation[..., 0]
    whole = _gripper_wrenches(log, filter_s, rotation)
    up = gripper_rotation(series.gripper_yaw_rad, series.gripper_tilt_rad)[..., 2]
    outward = _outward(axis, up[knot], series.on_wall[knot])
    leaning = _Leaning.of(plan, series, _outward(series.opening_axis, up, series.on_wall))
    given = (*whole, axis, log.inputs["finger_opening_m"], log.inputs["finger_force_n"])
    force, moment = split_between_fingers(*given) if leaning is None else leaning.at(knot).split(*given)
    outward = outward if leaning is None else leaning.normal[knot]
    on_wall, here = series.on_wall[knot], series.on_wall[knot][..., None, None]
    force = np.where(here, np.stack([whole[0], whole[0]], axis=2) / 2, force)
    moment = np.where(here, 0.0, moment)  # two pads beside each other bear what a point does not
    grip = _grip(plan, force, moment, outward, rotation[..., 2], on_wall, _surfaces(plan, series).at(knot))
    return grip.where((in_full_stance(log) & series.stance[knot])[..., None])
