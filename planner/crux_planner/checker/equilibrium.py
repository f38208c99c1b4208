"""What the controller makes of the plan's wrenches between the knots, where the body and a limb in the air move on as
wrenches blend from knot to knot; equilibrium there, the joint torques asked for, and the margin against tumbling.

The blended wrenches of a stance give accelerations between those of the knots (they are convex combinations of theirs)
but do not balance the moments: the body is not where either knot had it. The controller shares the load anew about the
centre of mass, by the wrenches of the limbs in stance. So the check is not that the residual is zero but that a
correction exists: the least change of forces and of twists about the finger axes, shared by load, that balances the
moment; with it every finger's demand must stay inside the limit surface (2a) for some normal force up to the plan's
limit, and no joint be asked for more than it has. The squeeze may rise: the grasp force controller sets it from the
demand.
"""

from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import Scenario

from crux_planner.checker import tolerances
from crux_planner.checker.cuboids import Cuboids
from crux_planner.checker.feet import foot_excess, nearest_in_cone
from crux_planner.checker.geometry import Array, cross, solved
from crux_planner.checker.kinematics import LimbMotion, held_torque
from crux_planner.checker.limb_model import BEARERS, WholeRobot
from crux_planner.checker.limit_surface import FingerLoads
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Correction, Findings, PeakTorque
from crux_planner.checker.sampling import Samples


def corrected_wrenches(
    samples: Samples,
    twist_length_m: float,
    about_w_m: Array,
    net: tuple[Array, Array] | None,
    *,
    point_model: bool = False,
) -> tuple[Array, Array, Array]:
    """Gripper forces and moments (T, 4, 3) after the least correction that balances the moment about the places
    `about_w_m` (T, 3) without changing the total force, and the residual (T,) [Nm] that no correction of the limbs in
    stance removes. With `net` the total force and moment are these, (T, 3) each; point feet have no twists.

    `twist_length_m` weighs a twist [Nm] against a force [N], as the controller's own sharing of loads does.
    """
    force, moment, axis = (v.transpose(1, 2, 0) for v in (samples.force, samples.moment, samples.opening_axis))
    arm = (samples.gripper_position - about_w_m[:, None, :]).transpose(1, 2, 0)  # (4, 3, T), as the others
    acts = arm + samples.below_m.transpose(1, 2, 0)
    share, directions = samples.load.T, 3 if point_model else 4
    lack = np.zeros((6, len(samples.time_s)))
    if net is not None:
        lack[:3], lack[3:] = net[0].T - force.sum(axis=0), net[1].T
    lack[3:] -= sum(cross(arm[limb], force[limb]) + moment[limb] for limb in range(4))
    effects = np.zeros((4, directions, 6, lack.shape[1]))  # of a force along each axis, and of a twist
    for limb in range(4):
        for i, along in enumerate(np.eye(3)):
            effects[limb, i, i] = 1.0
            effects[limb, i, 3:] = cross(acts[limb], along[:, None])
        if not point_model:
            effects[limb, 3, 3:] = twist_length_m * axis[limb] * ~samples.foot[:, limb]
    shared = share[:, None, None] * effects
    weights = _least_squares(np.einsum("ldit,ldjt->ijt", effects, shared), lack)
    change = np.einsum("ldit,it->ldt", shared, weights)
    left = lack - np.einsum("ldit,ldt->it", effects, change)
    force, moment = force + change[:, :3], moment.copy()
    if not point_model:
        moment += twist_length_m * change[:, 3:] * axis * ~samples.foot.T[:, None]
    if samples.foot.any():
        moment += np.cross(samples.below_m, change[:, :3].transpose(2, 0, 1)).transpose(1, 2, 0)
    return force.transpose(2, 0, 1), moment.transpose(2, 0, 1), np.abs(left).max(axis=0)


def _least_squares(normal: Array, right: Array) -> Array:
    """Least-norm solutions (6, T) of normal equations (6, 6, T), by the pseudoinverse where they nearly lack rank."""
    factors = normal.copy()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = solved(factors, right)
    pivots = np.diagonal(factors)  # (T, 6)
    poor = np.flatnonzero(~(pivots.min(axis=1) > _POOR_PIVOT * np.diagonal(normal).max(axis=1)))
    if len(poor) > 0:
        inverse = np.linalg.pinv(normal[..., poor].transpose(2, 0, 1), rcond=1e-9)
        found[:, poor] = (inverse @ right[:, poor].T[..., None])[..., 0].T
    return found


_POOR_PIVOT = 1e-4


def check_between_knots(
    plan: PlanArrays, shared: Samples, left: Array, loads: FingerLoads, scenario: Scenario, findings: Findings
) -> None:
    """Blended wrenches: none on a limb whose load is zero, and a correction inside the limit surface everywhere.

    `shared` has the corrected wrenches, `left` (T,) [Nm] is what no correction removes.
    """
    samples, force = shared, shared.force
    for limb in range(4):
        stray = np.where(samples.load[:, limb] <= 0.0, np.linalg.norm(force[:, limb], axis=1), -np.inf)
        findings.add_series("air_force_between_knots", stray, samples.time_s, "N", limb=limb)
    findings.add_series("equilibrium_between_knots", left, samples.time_s, "N m")
    for limb in range(4):
        at = samples.interval
        bears = samples.load[:, limb] > 0.0
        if scenario.contact.model == "point":
            normal = force[:, limb, 2]
            excess = loads.excess(force[:, limb, :2], np.zeros(len(at)), normal, (at, limb, 0), 0.0)
            excess = np.maximum(excess, normal - plan.max_normal_N)
        else:
            hanging = scenario.contact.spines_only.get(LIMB_NAMES[limb])
            excess = _grasp_excess(plan, samples, loads, limb, hanging)
            if samples.foot[:, limb].any():
                excess = np.where(samples.foot[:, limb], foot_excess(plan, samples, limb), excess)
        excess, tolerance = np.where(bears, excess, -np.inf), tolerances.FRICTION_CONE_BETWEEN_KNOTS_N
        name = "limit_surface_between_knots"
        findings.add_series(name, excess, samples.time_s, "N", tolerance=tolerance, limb=limb)


def _grasp_excess(plan: PlanArrays, samples: Samples, loads: FingerLoads, limb: int, hanging: int | None) -> Array:
    """Newtons by which a gripper's wrench exceeds what its two fingers can carry, each with half the shear and twist,
    the finger that is pushed harder at the largest normal force: the other one presses less by the pull between them.
    Where finger `hanging` hangs on by its spines only it does not press, and the other one takes the pull alone.
    """
    if (leans := plan.leaning[samples.interval, limb]).any():
        upright = _grasp_excess(replace(plan, cuboids=_uprighted(plan)), samples, loads, limb, hanging)
        return np.where(leans, _leaning_excess(plan, samples, loads, limb, hanging), upright)
    axis, at = samples.opening_axis[:, limb], samples.interval
    force, moment = samples.force[:, limb], samples.moment[:, limb]
    across, up = (samples.gripper_rotation[:, limb, :, i] for i in (1, 2))
    shear = 0.5 * np.stack([(force * across).sum(axis=1), (force * up).sum(axis=1)], axis=1)
    twist = 0.5 * (moment * axis).sum(axis=1)
    along = (force * axis).sum(axis=1)
    normal = np.stack([plan.max_normal_N + np.minimum(along, 0.0), plan.max_normal_N - np.maximum(along, 0.0)], axis=1)
    beyond = -normal.min(axis=1)
    if hanging is not None:
        pressing = along if hanging == 2 else -along
        normal = np.zeros_like(normal)
        normal[:, 2 - hanging] = pressing
        beyond = np.maximum(-pressing, pressing - plan.max_normal_N)
    excess = [loads.excess(shear, twist, normal[:, f], (at, limb, f), plan.patch_k_m) for f in (0, 1)]
    return np.asarray(np.maximum(np.maximum(*excess), beyond))


def _uprighted(plan: PlanArrays) -> Cuboids:
    return replace(plan.cuboids, lean_rad=np.zeros_like(plan.cuboids.lean_rad))


def _leaning_excess(plan: PlanArrays, samples: Samples, loads: FingerLoads, limb: int, hanging: int | None) -> Array:
    """The same where a face leans: both fingers have half of the force across the axis; the moment along it is of the
    twists about the normals, and of the places where the pads touch. Both press with half the pull more or less than
    the squeeze that the harder pressed one is left, none beyond the largest normal force.
    """
    if hanging is not None:
        return np.full(len(samples.time_s), plan.max_normal_N)  # no finger hangs on a leaning face
    axis, at = samples.opening_axis[:, limb], samples.interval
    force, normal = samples.force[:, limb], plan.face_normal[at, limb]
    along = (force * axis).sum(axis=1)
    across = 0.5 * (force - along[:, None] * axis)
    outward = np.stack([axis, -axis], axis=1)
    off = plan.pad_radius_m * (outward - normal)
    moment = (samples.moment[:, limb] - np.cross(off.sum(axis=1), across)) * axis
    twist = moment.sum(axis=1) / ((normal[:, 0] - normal[:, 1]) * axis).sum(axis=1)
    turned = np.array([0.0, 0.0, 1.0]) - normal[..., 2:] * normal  # up the face
    up = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    side = np.cross([0.0, 0.0, 1.0], axis)
    best = np.full(len(along), np.inf)
    for share in _SQUEEZES:
        squeeze = share * plan.max_normal_N - 0.5 * np.abs(along)
        press = squeeze[:, None] + 0.5 * along[:, None] * np.array([1.0, -1.0])
        each = press[..., None] * outward + across[:, None]
        pushed = (each * normal).sum(axis=-1)
        shear = np.stack([(each * side[:, None]).sum(axis=-1), (each * up).sum(axis=-1)], axis=-1)
        beyond = np.maximum(pushed.max(axis=1) - plan.max_normal_N, -press.min(axis=1))
        excess = [loads.excess(shear[:, f], twist, pushed[:, f], (at, limb, f), plan.patch_k_m) for f in (0, 1)]
        best = np.minimum(best, np.maximum(np.maximum(*excess), beyond))
    return best


_SQUEEZES = np.linspace(0.25, 1.0, 7)  # shares of the largest normal force, of which any will do


def tumble_margin(plan: PlanArrays, loads: FingerLoads, centre_w_m: Array, mass_kg: float) -> float | None:
    """Tumble stability margin min M_ab / (m g) [m] over knots 0..N-1 and tumbling axes.

    A tumbling axis runs through two contacts a, b in stance with all other grippers in stance on one side of it (in
    the plane of the wall). M_ab is the moment about it of gravity, which acts at the robot's centre of mass
    `centre_w_m` (N, 3), pressing positive, and of the pull off the wall which the other grippers can hold with the
    planned normal forces: friction mu fz and spines of both fingers.
    """
    weight = mass_kg * plan.gravity_w
    size = float(np.linalg.norm(weight))
    pull = np.where(loads.touching, loads.friction * np.maximum(loads.normal_N, 0.0) + loads.spine_shear_N, 0.0)
    pull = pull.sum(axis=2)[:-1].T
    feet = (plan.gripped | plan.on_wall | plan.standing)[:-1].T
    place, centre = plan.gripper_position[:-1].transpose(1, 2, 0), centre_w_m.T
    best = np.inf
    for a, b in permutations(range(len(feet)), 2):
        edge = (place[b] - place[a])[:2]
        length = np.sqrt((edge * edge).sum(axis=0))
        axis = np.array([*(edge / np.where(length < 1e-6, 1.0, length)), np.zeros_like(length)])
        others = [c for c in range(len(feet)) if c not in (a, b)]
        arms = [axis[0] * (place[c] - place[a])[1] - axis[1] * (place[c] - place[a])[0] for c in others]
        is_edge = feet[a] & feet[b] & (length >= 1e-6)
        for c, arm in zip(others, arms, strict=True):
            is_edge &= ~feet[c] | (arm >= 0.0)
        # about the edge: positive presses the inner side towards the wall
        gravity = -(cross(centre - place[a], weight[:, None]) * axis).sum(axis=0)
        holding = sum(np.where(feet[c], pull[c] * arm, 0.0) for c, arm in zip(others, arms, strict=True))
        best = min(best, float(np.where(is_edge, (gravity + holding) / size, np.inf).min()))
    return best if np.isfinite(best) else None


def along_plane(feet_w_m: Array, force_w: Array) -> Array:
    """Forces (T, 4, 3) of point feet at (T, 4, 3) with what acts along the wall shared by how hard each foot presses.

    Least sum of |f_t|^2 / f_z with the same normal forces and the same sums of forces and moments: the controller's
    sharing, which keeps a foot that presses less than planned inside its friction.
    """
    weight = np.maximum(force_w[:, :, 2], 0.0)[:, :, None]
    root = np.sqrt(weight[:, :, 0])
    centred = feet_w_m - feet_w_m.mean(axis=1, keepdims=True)
    x, y = centred[:, :, 0], centred[:, :, 1]
    effects = np.zeros((len(force_w), 3, 4, 2))  # of each foot's force on the sums along x, along y and about z
    effects[:, 0, :, 0] = effects[:, 1, :, 1] = 1.0
    effects[:, 2, :, 0], effects[:, 2, :, 1] = -y, x
    sums = np.einsum("tilj,tlj->ti", effects, force_w[:, :, :2])
    scaled = (effects * root[:, None, :, None]).reshape(len(force_w), 3, 8)
    least = np.einsum("tji,ti->tj", np.linalg.pinv(scaled), sums)
    shared = force_w.copy()
    shared[:, :, :2] = root[:, :, None] * least.reshape(-1, 4, 2)
    return shared


def shared_load(
    samples: Samples, centre_w_m: Array, net: tuple[Array, Array] | None, twist_length_m: float
) -> tuple[Samples, Array]:
    """The samples with the wrenches that the controller makes of the plan's: balanced about the centre of mass
    (T, 3) and, on feet, with what acts along the wall shared anew. And what no correction removes, (T,).

    `net` are the force and moment that point feet must have together; None for grasps, whose forces sum as planned.
    """
    force, moment, left = corrected_wrenches(samples, twist_length_m, centre_w_m, net, point_model=net is not None)
    if net is not None:
        force = along_plane(samples.gripper_position, force)
    return replace(samples, force=force, moment=moment), left


def within_cones(
    plan: PlanArrays, planned: Samples, shared: tuple[Samples, Array], centre_w_m: Array, twist_length_m: float
) -> tuple[Samples, Array]:
    """What `shared_load` made of the `planned` samples, with what feet on footholds cannot bear given to the others, as
    the controller does: feet beyond their cones bear the nearest forces in them, and all is balanced anew about that,
    some times in turn; then those that still are beyond keep such a force, and the rest is balanced about them.
    """
    (found, left), begun = shared, planned
    net, stands = (planned.force.sum(axis=1), np.zeros_like(centre_w_m)), planned.foot & (planned.load > 0.0)
    fixed = np.zeros(planned.load.shape, dtype=bool)
    for turn in range(_TURNS + len(LIMB_NAMES)):
        nearest = nearest_in_cone(plan, found)
        beyond = stands & ~fixed & (np.linalg.norm(nearest - found.force, axis=2) > _IN_CONE_N)
        if not beyond.any():
            break
        if turn < _TURNS:
            begun, kept = found, stands
        else:
            kept = beyond
            fixed |= beyond
        force = np.where(kept[..., None], nearest, begun.force)
        moment = np.where(kept[..., None], np.cross(begun.below_m, force), begun.moment)
        begun = replace(begun, force=force, moment=moment)
        others = replace(begun, load=np.where(fixed, 0.0, begun.load))
        force, moment, left = corrected_wrenches(others, twist_length_m, centre_w_m, net)
        found = replace(begun, force=force, moment=moment)
    return found, left


_TURNS = 10
_IN_CONE_N = 1e-9  # so near to its cone a foot's force counts as in it


def correction(planned: Samples, shared: Samples, centre_w_m: Array) -> Correction:
    """What the `planned` wrenches lack about the centre of mass (T, 3), and what the `shared` ones add to a gripper."""
    arm = planned.gripper_position - centre_w_m[:, None, :]
    moment = (np.cross(arm, planned.force) + planned.moment).sum(axis=1)
    added = np.linalg.norm(shared.force - planned.force, axis=2)
    return Correction(float(np.linalg.norm(moment, axis=1).max()), float(added.max()))


def check_torques(
    samples: Samples, motions: list[LimbMotion], robot: WholeRobot, gravity_w: Array, findings: Findings
) -> PeakTorque:
    """No joint is asked for more than it can give, with the shared wrenches in `samples` acting at the grippers'
    centres; returns the joint and moment that come closest to that, or furthest beyond.
    """
    torques, efforts, names = [], [], []
    for index, (limb, motion) in enumerate(zip(robot.limbs, motions, strict=True)):
        torque, most_Nm, borne_by = limb.borne(motion.state, held_torque(limb, motion.state, samples, index, gravity_w))
        torques.append(np.where(motion.reached[:, None], np.abs(torque), 0.0))
        efforts.append(most_Nm)
        names.append(borne_by)
        for number, (name, most, size) in enumerate(zip(borne_by, most_Nm, torques[-1].T, strict=True)):
            beyond = np.where(motion.reached, size - most, -np.inf)
            where: dict[str, Any] = {"tolerance": tolerances.TORQUE_NM, "limb": index, "detail": name}
            actuator, joint = divmod(number, len(limb.joints))
            constraint = f"{BEARERS[actuator]}_torque_shared"
            findings.add_series(constraint, beyond, samples.time_s, "N m", joint=joint, **where)
    sizes, most_Nm = np.stack(torques), np.stack(efforts)
    i, row, j = np.unravel_index(int(np.argmax(sizes / most_Nm[:, None])), sizes.shape)
    borne = float(sizes[i, row, j]), float(most_Nm[i, j])
    return PeakTorque(robot.limbs[i].name, names[i][j], float(samples.time_s[row]), *borne)
