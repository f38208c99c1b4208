"""A plan's messages as arrays, once their form is sound."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from crux_contracts import N_LIMBS
from crux_msgs import limb_knot_t

from crux_planner.checker.cuboids import OUTWARD, Cuboids
from crux_planner.checker.footholds import (
    NO_FOOTHOLDS,
    NOWHERE,
    Footholds,
    above_m,
    first_foothold,
    misplaced,
    read_footholds,
)
from crux_planner.checker.geometry import (
    Array,
    Flags,
    Indices,
    rotation_of_gripper,
)
from crux_planner.checker.report import Findings

STANCE, AIR = limb_knot_t.STANCE, limb_knot_t.AIR
FACE_NONE, FACE_WALL = limb_knot_t.FACE_NONE, limb_knot_t.FACE_WALL

MIN_STEP_S = 1e-3
"""Between knots with times of their own."""

_ROUNDING = 1e-9  # of unit vectors


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
    footholds: Footholds = NO_FOOTHOLDS
    """In plan_t.holds after the cuboids. `gripper_position` of a limb that stands on one is that of its frame."""

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
            return np.broadcast_to(OUTWARD[4], (*self.hold.shape, 3))
        index = np.where(self.gripped, self.hold, 0)
        return np.where(self.gripped[..., None], self.cuboids.rotation[index][..., 2], OUTWARD[4])

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
    def standing(self) -> Flags:
        """(K, 4): in stance on a foothold that exists."""
        number = self.hold - len(self.cuboids.names)
        exists = (number >= 0) & (number < len(self.footholds.names))
        return np.asarray(self.stance & exists & (self.finger1_face == FACE_WALL))

    @cached_property
    def foothold(self) -> Indices:
        """(K, 4): number of the foothold where `standing`, 0 elsewhere."""
        return np.where(self.standing, self.hold - len(self.cuboids.names), 0)

    @cached_property
    def foothold_surface(self) -> Indices:
        """(K, 4): that a foot stands on, as Footholds.surface has it; NOWHERE where no limb stands."""
        if not self.footholds.names:
            return np.full(self.hold.shape, NOWHERE)
        return np.where(self.standing, self.footholds.surface[self.foothold], NOWHERE)

    @cached_property
    def on_place(self) -> Indices:
        """(K, 4): index of the hold gripped or the foothold stood on, -1 where there is none."""
        return np.where(self.gripped | self.standing, self.hold, -1)

    @property
    def place_names(self) -> tuple[str, ...]:
        """Of cuboids and footholds, as plan_t.holds has them."""
        return (*self.cuboids.names, *self.footholds.names)

    @cached_property
    def above_foot(self) -> Array:
        """(K, 4, 3): from where a foot's force acts to its gripper's frame; 0 for all others."""
        up = rotation_of_gripper(self.gripper_yaw, self.gripper_tilt)[..., 2]
        return above_m(self.standing, up, self.pad_radius_m)

    @property
    def foot_point(self) -> Array:
        """(K, 4, 3): where a foot's force acts; the grippers' centres elsewhere."""
        return np.asarray(self.gripper_position - self.above_foot)

    @property
    def force_position(self) -> Array:
        """(K, 4, 2, 3): where the fingers' forces act: `finger_position`, of a foot about its foot point."""
        if not self.standing.any():
            return self.finger_position
        return np.asarray(self.finger_position - self.above_foot[:, :, None])

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
        """(K, 4): in stance on the wall itself (point contact), and on no foothold."""
        return np.asarray(self.stance & (self.finger1_face == FACE_WALL) & ~self.standing)

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
        local = OUTWARD[self.faces]
        if not self.cuboids.names:
            return np.asarray(local)
        index = np.where(self.gripped, self.hold, 0)
        turn = np.where(self.gripped[..., None, None], self.cuboids.rotation[index], np.eye(3))
        upright = np.einsum("klij,klfj->klfi", turn, local)
        if not self.leaning.any():
            return np.asarray(upright)
        return np.asarray(np.cos(self.lean)[..., None] * upright + np.sin(self.lean)[..., None] * OUTWARD[4])


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
    first = first_foothold(plan.holds)
    try:
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
            _read(plan.knots, "time_s", plan.n_knots),
            _read(plan.knots, "body_position_w_m", -1, 3),
            _read(plan.knots, "body_rpy_rad", -1, 3),
            _read(plan.knots, "body_velocity_w_m_s", -1, 3),
            _read(plan.knots, "body_angular_velocity_b_rad_s", -1, 3),
            _read(limbs, "phase", *shape, kind=int),
            _read(limbs, "hold", *shape, kind=int),
            _read(limbs, "finger1_face", *shape, kind=int),
            _read(limbs, "friction", *shape),
            _read(limbs, "gripper_position_w_m", *shape, 3),
            _read(limbs, "gripper_yaw_w_rad", *shape),
            _read(limbs, "gripper_tilt_w_rad", *shape, 2),
            _read(limbs, "finger_separation_m", *shape),
            _read(limbs, "finger_force_w_n", *shape, 2, 3),
            _read(limbs, "finger_moment_w_nm", *shape, 2, 3),
            _cuboids(plan.holds[:first]),
            pad_radius_m,
            read_footholds(plan.holds[first:]),
        )
    except (TypeError, ValueError) as error:
        findings.add("plan_format", 1.0, "", detail=f"a field has the wrong length or type: {error}")
        return None
    if not _sound(arrays, findings):
        return None
    return replace(arrays, gripper_position=arrays.gripper_position + arrays.above_foot)


def _read(messages: Any, name: str, *shape: int, kind: type = float) -> Any:
    """A field of all messages."""
    return np.array([getattr(message, name) for message in messages], dtype=kind).reshape(shape)


def _cuboids(bodies: Any) -> Cuboids:
    """Of a plan's holds and obstacles."""
    return Cuboids(
        tuple(hold.name for hold in bodies),
        _read(bodies, "graspable", -1) != 0,
        _read(bodies, "position_w_m", -1, 3),
        _read(bodies, "size_m", -1, 3),
        _read(bodies, "yaw_rad", -1),
        _read(bodies, "friction", -1, 5),
        _read(bodies, "spines", -1, 5) != 0,
        _read(bodies, "lean_rad", -1, 4),
        _read(bodies, "tilt_rad", -1, 2),
    )


def _steps(plan: Any) -> Array:
    """From each knot to the next (K - 1,)."""
    if plan.format < plan.FORMAT_OWN_TIMES:
        return np.full(plan.n_knots - 1, float(plan.dt_s))
    return np.diff(np.array([knot.time_s for knot in plan.knots], dtype=float))


def _fault_of_form(plan: Any) -> str | None:
    """Why the message has not the form that arrays are read from; None where it has."""
    knots, holds = len(plan.knots), len(plan.holds)
    if not plan.FORMAT <= plan.format <= plan.FORMAT_FEET:
        return f"format is {plan.format}, this checker knows {plan.FORMAT} to {plan.FORMAT_FEET}"
    if misplaced(plan.holds):
        return "a hold or an obstacle comes after a foothold"
    if (first_foothold(plan.holds) < holds) != (plan.format == plan.FORMAT_FEET):
        return f"format is {plan.format}, expected {plan.FORMAT_FEET} where there are footholds, and only there"
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
    for owner in (plan, plan.cuboids, plan.footholds):
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
