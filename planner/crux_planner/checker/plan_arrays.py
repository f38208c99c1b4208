"""A plan's messages as arrays, once their form is sound."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from crux_contracts import N_LIMBS
from crux_contracts.scenario import Slab
from crux_msgs import limb_knot_t

from crux_planner.checker.geometry import (
    Array,
    Flags,
    Indices,
    rotation_about_z,
    rotation_from_rpy,
    rotation_of_gripper,
)
from crux_planner.checker.report import Findings

STANCE, AIR = limb_knot_t.STANCE, limb_knot_t.AIR
FACE_NONE, FACE_WALL = limb_knot_t.FACE_NONE, limb_knot_t.FACE_WALL

MIN_STEP_S = 1e-3
"""Between knots with times of their own."""

_ROUNDING = 1e-9  # of unit vectors

_OUTWARD = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""Outward normals of a cuboid's faces in its own frame: +x, -x, +y, -y, top (of the wall itself: FACE_WALL)."""


@dataclass(frozen=True)
class Cuboids:
    """Holds and obstacles, shapes (H, ...); friction and spines by face: +x, -x, +y, -y, top."""

    names: tuple[str, ...]
    graspable: Flags
    foot_w_m: Array
    size_m: Array
    yaw_rad: Array
    friction: Array
    spines: Flags
    lean_rad: Array
    """Of the side faces, off the upright, (H, 4)."""
    tilt_rad: Array
    """Roll and pitch, (H, 2)."""

    @cached_property
    def centre_w_m(self) -> Array:
        """Centres (H, 3)."""
        if not self.tilt_rad.any():
            return self.foot_w_m + np.array([0.0, 0.0, 0.5]) * self.size_m
        return self.foot_w_m + 0.5 * self.size_m[:, 2:] * self.rotation[:, :, 2]

    @cached_property
    def rotation(self) -> Array:
        """Rotations W <- cuboid, shape (H, 3, 3)."""
        if not self.tilt_rad.any():
            return rotation_about_z(self.yaw_rad)
        return rotation_from_rpy(np.column_stack([self.tilt_rad, self.yaw_rad]))

    def side_planes(self, index: int) -> tuple[Array, Array]:
        """Outward normals (4, 3) and offsets (4,) of a cuboid's side faces in its centred frame: n . p is the offset on
        a face, which stands on the foot's edge and leans in.
        """
        cosine, sine = np.cos(self.lean_rad[index]), np.sin(self.lean_rad[index])
        normals = cosine[:, None] * _OUTWARD[:4] + sine[:, None] * _OUTWARD[4]
        half = 0.5 * self.size_m[index]
        return normals, cosine * half[[0, 0, 1, 1]] - sine * half[2]

    def with_slabs(self, slabs: tuple[Slab, ...]) -> "Cuboids":
        """These, and after them the solids behind bounded surfaces."""
        if not slabs:
            return self
        more = len(slabs)
        parts = (
            (self.graspable, np.zeros(more, dtype=bool)),
            (self.foot_w_m, [(*slab.position_m, slab.foot_z_m) for slab in slabs]),
            (self.size_m, [slab.size_m for slab in slabs]),
            (self.yaw_rad, [slab.yaw_rad for slab in slabs]),
            (self.friction, np.zeros((more, 5))),
            (self.spines, np.zeros((more, 5), dtype=bool)),
            (self.lean_rad, np.zeros((more, 4))),
            (self.tilt_rad, [slab.tilt_rad for slab in slabs]),
        )
        names = (*self.names, *(f"the surface {slab.name}" for slab in slabs))
        return Cuboids(names, *(np.concatenate(pair) for pair in parts))

    @cached_property
    def reach_w_m(self) -> Array:
        """Half extents along the axes of W, (H, 3)."""
        return np.asarray((np.abs(self.rotation) @ (0.5 * self.size_m[..., None]))[..., 0])


@dataclass(frozen=True)
class PlanArrays:
    """Knots k = 0..N (K = N + 1) of the four limbs; names as in the LCM types."""

    dt_s: float
    own_times: bool
    """Knots stand at times of their own."""
    fingers_move: bool
    """Fingers move while a gripper lifts and comes down."""
    step_s: Array
    """(K - 1,) from each knot to the next: dt_s, or as the knots' own times have it."""
    gravity_w: Array
    patch_k_m: float
    max_normal_N: float
    spine_shear_N: float
    spine_twist_Nm: float
    time_s: Array
    body_position: Array
    body_rpy: Array
    body_velocity: Array
    body_rate: Array
    phase: Indices
    hold: Indices
    finger1_face: Indices
    friction: Array
    gripper_position: Array
    gripper_yaw: Array
    gripper_tilt: Array
    """Rotation vectors about x and y of W, (K, 4, 2)."""
    separation: Array
    finger_force: Array
    finger_moment: Array
    cuboids: Cuboids
    pad_radius_m: float
    """Pads are balls: on a face that leans they touch beside the opening axis."""

    @cached_property
    def n_knots(self) -> int:
        """K."""
        return len(self.time_s)

    @cached_property
    def stance(self) -> Flags:
        """(K, 4)."""
        return np.asarray(self.phase == STANCE)

    @cached_property
    def opening_axis(self) -> Array:
        """e of every gripper, (K, 4, 3)."""
        return rotation_of_gripper(self.gripper_yaw, self.gripper_tilt)[..., 0]

    @cached_property
    def off_hold(self) -> Array:
        """z of the hold gripped, the way off it, (K, 4, 3); W's z where there is none."""
        if not self.cuboids.names or not self.cuboids.tilt_rad.any():
            return np.broadcast_to(_OUTWARD[4], (*self.hold.shape, 3))
        index = np.where(self.gripped, self.hold, 0)
        return np.where(self.gripped[..., None], self.cuboids.rotation[index][..., 2], _OUTWARD[4])

    @cached_property
    def gripper_z_on_hold(self) -> Array:
        """z of the gripper along the axes of the hold gripped, (K, 4, 3); along W's where there is none."""
        z = rotation_of_gripper(self.gripper_yaw, self.gripper_tilt)[..., 2]
        if not self.cuboids.names:
            return np.asarray(z)
        turn = np.where(self.gripped[..., None, None], self.cuboids.rotation[self.gripped_hold], np.eye(3))
        return np.asarray(np.einsum("klij,kli->klj", turn, z))

    @cached_property
    def up_face(self) -> Array:
        """(K, 4, 3): the second way along upright faces in which spines hold; the gripper's z, where that is on its own
        hold at an angle, else the hold's.
        """
        turn = rotation_of_gripper(self.gripper_yaw, self.gripper_tilt)
        aslant = self.gripped & ~self.leaning & (np.abs(self.gripper_z_on_hold[..., :2]).max(axis=-1) > _ROUNDING)
        return np.where(aslant[..., None], turn[..., 2], self.off_hold)

    @cached_property
    def finger_position(self) -> Array:
        """Of the pads' faces on the opening axis, fingers 1 and 2, (K, 4, 2, 3): there pads touch upright faces."""
        half = 0.5 * self.separation[..., None] * self.opening_axis
        return np.stack([self.gripper_position + half, self.gripper_position - half], axis=2)

    @cached_property
    def touch_m(self) -> Array:
        """Where the pads touch, off `finger_position`, (K, 4, 2, 3)."""
        outward = np.stack([self.opening_axis, -self.opening_axis], axis=2)
        off = self.pad_radius_m * (outward - self.face_normal)
        return np.where(self.leaning[..., None, None], off, 0.0)

    @cached_property
    def touch_moment(self) -> Array:
        """The fingers' moments about where they touch, (K, 4, 2, 3)."""
        if not self.leaning.any():
            return self.finger_moment
        return np.asarray(self.finger_moment - np.cross(self.touch_m, self.finger_force))

    @cached_property
    def lean(self) -> Array:
        """Of the faces under fingers 1 and 2, (K, 4, 2) [rad]."""
        if not self.cuboids.names:
            return np.zeros((*self.hold.shape, 2))
        index = np.where(self.gripped, self.hold, 0)[..., None]
        return np.where(self.gripped[..., None], self.cuboids.lean_rad[index, np.minimum(self.faces, 3)], 0.0)

    @cached_property
    def leaning(self) -> Flags:
        """(K, 4): gripped by a face that leans."""
        return np.asarray(self.lean.any(axis=2))

    @cached_property
    def gripped(self) -> Flags:
        """(K, 4): in stance on a hold that exists, by faces that exist."""
        exists = (self.hold >= 0) & (self.hold < len(self.cuboids.names))
        return np.asarray(self.stance & exists & (self.finger1_face >= 0) & (self.finger1_face < 4))

    @cached_property
    def gripped_hold(self) -> Indices:
        """(K, 4): the hold where `gripped`, -1 elsewhere."""
        return np.where(self.gripped, self.hold, -1)

    @cached_property
    def hold_before(self) -> Indices:
        """(K, 4): the hold gripped at the knot before; at the first, that between whose faces a gripper stands in the
        air; -1 where there is none.
        """
        place, cuboids = self.gripper_position[0], self.cuboids
        first = np.full((1, N_LIMBS), -1)
        if cuboids.names:
            away = np.einsum("hij,lhi->lhj", cuboids.rotation, place[:, None] - cuboids.centre_w_m)
            inside = (np.abs(away) < 0.5 * cuboids.size_m).all(axis=2)
            first[0] = np.where(inside.any(axis=1) & ~self.stance[0], inside.argmax(axis=1), -1)
        return np.concatenate([first, self.gripped_hold[:-1]])

    @cached_property
    def on_wall(self) -> Flags:
        """(K, 4): in stance on the wall itself (point contact)."""
        return np.asarray(self.stance & (self.finger1_face == FACE_WALL))

    @cached_property
    def point_feet(self) -> bool:
        """Every limb in stance stands on the wall itself: a walk (msgs/PLAN.md)."""
        return bool((self.on_wall | ~self.stance).all())

    @cached_property
    def faces(self) -> Indices:
        """Faces under fingers 1 and 2, (K, 4, 2); +x opposite -x, +y opposite -y; wall for both; 0 where none."""
        first = np.where(self.gripped, self.finger1_face, 0)
        second = first ^ 1
        wall = np.full_like(first, FACE_WALL)
        on_wall = self.on_wall
        return np.stack([np.where(on_wall, wall, first), np.where(on_wall, wall, second)], axis=2)

    @cached_property
    def face_normal(self) -> Array:
        """Outward normals under both fingers in W, (K, 4, 2, 3)."""
        local = _OUTWARD[self.faces]
        if not self.cuboids.names:
            return np.asarray(local)
        index = np.where(self.gripped, self.hold, 0)
        turn = np.where(self.gripped[..., None, None], self.cuboids.rotation[index], np.eye(3))
        upright = np.einsum("klij,klfj->klfi", turn, local)
        if not self.leaning.any():
            return np.asarray(upright)
        return np.asarray(np.cos(self.lean)[..., None] * upright + np.sin(self.lean)[..., None] * _OUTWARD[4])


def read_plan(plan: Any, findings: Findings, pad_radius_m: float = 0.0) -> PlanArrays | None:
    """Arrays of a crux_msgs.plan_t, or None after reporting why its form does not allow any further check; the pads'
    radius matters where faces lean.
    """
    fault = _fault_of_form(plan)
    if fault is not None:
        findings.add("plan_format", 1.0, "", detail=fault)
        return None
    limbs = [limb for knot in plan.knots for limb in knot.limbs]
    shape = (plan.n_knots, N_LIMBS)

    def read(messages: Any, name: str, *shape: int, kind: type = float) -> Any:
        return np.array([getattr(message, name) for message in messages], dtype=kind).reshape(shape)

    try:
        cuboids = Cuboids(
            tuple(hold.name for hold in plan.holds),
            read(plan.holds, "graspable", plan.n_holds) != 0,
            read(plan.holds, "position_w_m", plan.n_holds, 3),
            read(plan.holds, "size_m", plan.n_holds, 3),
            read(plan.holds, "yaw_rad", plan.n_holds),
            read(plan.holds, "friction", plan.n_holds, 5),
            read(plan.holds, "spines", plan.n_holds, 5) != 0,
            read(plan.holds, "lean_rad", plan.n_holds, 4),
            read(plan.holds, "tilt_rad", plan.n_holds, 2),
        )
        arrays = PlanArrays(
            float(plan.dt_s),
            plan.format >= plan.FORMAT_OWN_TIMES,
            plan.format == plan.FORMAT_MOVING_FINGERS,
            _steps(plan),
            np.array(plan.gravity_w_m_s2, dtype=float).reshape(3),
            float(plan.patch_k_m),
            float(plan.max_normal_n),
            float(plan.spine_shear_n),
            float(plan.spine_twist_nm),
            read(plan.knots, "time_s", plan.n_knots),
            read(plan.knots, "body_position_w_m", -1, 3),
            read(plan.knots, "body_rpy_rad", -1, 3),
            read(plan.knots, "body_velocity_w_m_s", -1, 3),
            read(plan.knots, "body_angular_velocity_b_rad_s", -1, 3),
            read(limbs, "phase", *shape, kind=int),
            read(limbs, "hold", *shape, kind=int),
            read(limbs, "finger1_face", *shape, kind=int),
            read(limbs, "friction", *shape),
            read(limbs, "gripper_position_w_m", *shape, 3),
            read(limbs, "gripper_yaw_w_rad", *shape),
            read(limbs, "gripper_tilt_w_rad", *shape, 2),
            read(limbs, "finger_separation_m", *shape),
            read(limbs, "finger_force_w_n", *shape, 2, 3),
            read(limbs, "finger_moment_w_nm", *shape, 2, 3),
            cuboids,
            pad_radius_m,
        )
    except (TypeError, ValueError) as error:
        findings.add("plan_format", 1.0, "", detail=f"a field has the wrong length or type: {error}")
        return None
    return arrays if _sound(arrays, findings) else None


def _steps(plan: Any) -> Array:
    """From each knot to the next (K - 1,)."""
    if plan.format < plan.FORMAT_OWN_TIMES:
        return np.full(plan.n_knots - 1, float(plan.dt_s))
    return np.diff(np.array([knot.time_s for knot in plan.knots], dtype=float))


def _fault_of_form(plan: Any) -> str | None:
    """Why the message has not the form that arrays are read from; None where it has."""
    knots, holds = len(plan.knots), len(plan.holds)
    if not plan.FORMAT <= plan.format <= plan.FORMAT_MOVING_FINGERS:
        return f"format is {plan.format}, this checker knows {plan.FORMAT} to {plan.FORMAT_MOVING_FINGERS}"
    if plan.format == plan.FORMAT and knots and any(limb.phase == AIR for limb in plan.knots[0].limbs):
        return f"a limb is in the air at the first knot, which plans of format {plan.FORMAT} may not have"
    if plan.n_knots != knots or plan.n_holds != holds or plan.n_knots < 2:
        counts = f"{plan.n_knots} knots announced, {knots} there; {plan.n_holds} holds announced, {holds} there"
        return f"{counts}; at least 2 knots are needed"
    if sum(len(knot.limbs) for knot in plan.knots) != N_LIMBS * plan.n_knots:
        return f"a knot has other than {N_LIMBS} limbs"
    return None


def _sound(plan: PlanArrays, findings: Findings) -> bool:
    """Finite numbers, a positive step, knots in order of time, known phases: what every other check builds on."""
    sound = True
    for owner in (plan, plan.cuboids):
        for name in (entry.name for entry in fields(owner)):
            value = getattr(owner, name)
            if not isinstance(value, float | np.ndarray):
                continue
            array = np.asarray(value, dtype=float)
            if not np.isfinite(array).all():
                sound = False
                bad = np.argwhere(~np.isfinite(array))[0]
                at_knot = owner is plan and array.ndim > 0 and len(array) == plan.n_knots
                findings.add(
                    "finite_numbers",
                    1.0,
                    "",
                    limb=int(bad[1]) if at_knot and len(bad) > 1 and array.shape[1] == N_LIMBS else None,
                    time_s=float(bad[0] * plan.dt_s) if at_knot else None,
                    detail=f"{name}{bad.tolist() or ''} is not a finite number",
                )
    if not sound:
        return False
    if plan.dt_s <= 0.0:
        findings.add("time_stamps", -plan.dt_s, "s", tolerance=-1.0, detail="dt_s must be positive")
        return False
    if plan.own_times:
        ordered = _ordered(plan, findings)
    else:
        clock, tolerance_s = np.abs(plan.time_s - plan.dt_s * np.arange(plan.n_knots)), 1e-9 * max(plan.dt_s, 1.0)
        findings.add_series("time_stamps", clock, plan.time_s, "s", tolerance=tolerance_s * plan.n_knots)
        ordered = bool(clock.max() <= 0.01 * plan.dt_s)
    known = np.isin(plan.phase, (STANCE, AIR))
    for k, limb in np.argwhere(~known):
        detail = f"phase {plan.phase[k, limb]} is neither STANCE ({STANCE}) nor AIR ({AIR})"
        findings.add("plan_format", 1.0, "", limb=limb, time_s=plan.time_s[k], detail=detail)
    sized = bool((plan.cuboids.size_m > 0.0).all())
    if not sized:
        index = int(np.argwhere((plan.cuboids.size_m <= 0.0).any(axis=1))[0, 0])
        findings.add("plan_format", 1.0, "", detail=f"hold {plan.cuboids.names[index]!r} has no volume")
    return sized and bool(known.all()) and ordered


def _ordered(plan: PlanArrays, findings: Findings) -> bool:
    """Knots with times of their own: of a climb, from 0 on, each later than the one before."""
    if plan.point_feet:
        findings.add("plan_format", 1.0, "", detail="the knots of a walk stand every dt_s")
    late = np.append(np.abs(plan.time_s[0]), MIN_STEP_S - plan.step_s)
    findings.add_series("time_stamps", late, plan.time_s, "s", tolerance=1e-12)
    return not plan.point_feet and bool((late <= 1e-12).all())
