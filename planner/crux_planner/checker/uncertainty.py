"""The plan at the corners of what the scenario calls uncertain.

Looked at once an interval, in its middle, where a knot's wrenches act whole. The controller feels another weight, or a
centre of mass that is elsewhere, and shares it by the least change of forces and twists; of friction and of how a hold
is turned it knows nothing, so the planned squeeze has to do, on the limbs that bear. Holds that are elsewhere move the
forces: corners are those of the box that holds all moments which that and the centre of mass can make, so some of them
may be beyond what can happen.
"""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, Uncertainty

from crux_planner.checker.dynamics import centre_of_mass
from crux_planner.checker.equilibrium import corrected_wrenches
from crux_planner.checker.geometry import Array, rotation_of_gripper
from crux_planner.checker.kinematics import LimbMotion, check_kinematics, held_torque
from crux_planner.checker.limb_model import BEARERS, WholeRobot, load_model
from crux_planner.checker.limit_surface import FingerLoads
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples, sample_at

WHOLE = 0.45  # of an interval: wrenches of the knot before have blended out, those of the next not begun
_REACH = ("inverse_kinematics", "inverse_kinematics_orientation", "joint_position", "actuator_position",
          "linkage_singular")  # fmt: skip


def check_uncertainty(
    plan: PlanArrays, scenario: Scenario, loads: FingerLoads, robot: Robot, findings: Findings
) -> None:
    """Limit surface, joint torques and reach at every corner; what is beyond is a violation with `uncertain` in its
    name.
    """
    known = scenario.uncertainty
    assert known is not None
    model, continuous_Nm = load_model(robot), np.array(robot.servo.continuous_torque_Nm)
    samples = sample_at(plan, np.arange(plan.n_knots - 1), np.full(plan.n_knots - 1, WHOLE))
    motions, *_ = check_kinematics(samples, model, plan.gravity_w, continuous_Nm, Findings())
    centre = centre_of_mass(samples, model, [motion.state for motion in motions])
    surface = np.full((2, 4, len(samples.time_s)), -np.inf)
    own = [np.zeros((len(samples.time_s), len(limb.joints))) for limb in model.limbs]
    each = zip(model.limbs, motions, own, strict=True)
    bearers = [limb.borne(motion.state, none)[2] for limb, motion, none in each]
    torque = [np.full((len(samples.time_s), len(names)), -np.inf) for names in bearers]
    for force, moment in _corners(samples, centre, known, model.mass_kg, robot.control.twist_length_m):
        shared = replace(samples, force=force, moment=moment)
        for turned_rad in {known.hold_yaw_rad, -known.hold_yaw_rad}:
            surface = np.maximum(surface, _surface_excess(plan, scenario, loads, samples, shared, turned_rad))
        for limb, worst in enumerate(torque):
            np.maximum(worst, _torque_excess(model, limb, motions[limb], shared, plan.gravity_w), out=worst)
    bears = samples.load.T > 0.0
    for limb in range(4):
        for finger in (0, 1):
            excess = np.where(bears[limb], surface[finger, limb], -np.inf)
            findings.add_series("limit_surface_uncertain", excess, samples.time_s, "N", limb=limb, finger=finger + 1)
        for j, (name, lacks) in enumerate(zip(bearers[limb], torque[limb].T, strict=True)):
            actuator, joint = divmod(j, len(model.limbs[limb].joints))
            where: dict[str, Any] = {"limb": limb, "detail": name, "joint": joint}
            findings.add_series(f"{BEARERS[actuator]}_torque_uncertain", lacks, samples.time_s, "N m", **where)
    _check_reach(samples, known, model, plan.gravity_w, continuous_Nm, findings)


def _corners(
    samples: Samples, centre_w_m: Array, known: Uncertainty, mass_kg: float, twist_length_m: float
) -> list[tuple[Array, Array]]:
    """Gripper forces and moments (T, 4, 3) that the controller makes of the plan's at every corner.

    The whole force grows with the mass; the moment about the centre of mass is then off by where that and the holds
    are, each component by as much as all of them together can make.
    """
    total, surface = samples.force.sum(axis=1), _surface_axes(samples)
    along = np.abs(total)
    aside = known.centre_of_mass_m * (along.sum(axis=1, keepdims=True) - along)
    moved = known.hold_position_m * np.abs(np.cross(surface, samples.force[..., None, :])).sum(axis=(1, 2))
    masses = sorted({1.0 + known.mass_kg / mass_kg, 1.0 - known.mass_kg / mass_kg})
    found = []
    for grown, signs in product(masses, product((-1.0, 1.0), repeat=3)):
        net = (grown * total, np.array(signs) * (grown * aside + moved))
        found.append(corrected_wrenches(samples, twist_length_m, centre_w_m, net)[:2])
    return found


def _surface_axes(samples: Samples) -> Array:
    """Along which holds may lie elsewhere, (T, 4, 2, 3): W's x and y, turned out of the wall's plane as a hold is."""
    turned = rotation_of_gripper(np.zeros_like(samples.gripper_yaw), samples.gripper_tilt)
    return turned[..., :2].swapaxes(-1, -2)


def _surface_excess(
    plan: PlanArrays, scenario: Scenario, loads: FingerLoads, planned: Samples, shared: Samples, turned_rad: float
) -> Array:
    """(2, 4, T) [N] by which each finger's wrench is beyond the limit surface of its face with the least friction, with
    the planned squeeze, on holds that are turned by `turned_rad`.
    """
    known, knots = scenario.uncertainty, planned.interval
    assert known is not None
    turned = rotation_of_gripper(planned.gripper_yaw + turned_rad, planned.gripper_tilt)
    axis = turned[..., 0]
    shear = 0.5 * np.einsum("tlij,tli->tlj", turned[..., 1:], shared.force)
    twist = 0.5 * (shared.moment * axis).sum(axis=-1)
    pull = (shared.force * axis).sum(axis=-1) - (planned.force * planned.opening_axis).sum(axis=-1)
    shares = np.full((2, 4, 1), 0.5)
    for name, finger in scenario.contact.spines_only.items():
        limb = LIMB_NAMES.index(name)
        shares[:, limb] = 1.0
        shares[finger - 1, limb] = 0.0
    excess = np.empty((2, *pull.T.shape))
    for finger, sign in ((0, 1.0), (1, -1.0)):
        normal = loads.normal_N[knots, :, finger] + sign * shares[finger].T * pull
        at = (knots, slice(None), finger)
        beyond = loads.excess(shear, twist, normal, at, plan.patch_k_m, 1.0 - known.friction)
        excess[finger] = np.maximum(beyond, np.maximum(-normal, normal - plan.max_normal_N)).T
    return excess


def _torque_excess(model: WholeRobot, index: int, motion: LimbMotion, shared: Samples, gravity_w: Array) -> Array:
    """(T, K) [N m] by which what a limb's joints hang on is asked for more than it can give."""
    limb = model.limbs[index]
    torque, most_Nm, _ = limb.borne(motion.state, held_torque(limb, motion.state, shared, index, gravity_w))
    beyond = np.abs(torque) - most_Nm
    return np.where(motion.reached[:, None], beyond, -np.inf)


def _check_reach(
    samples: Samples, known: Uncertainty, model: WholeRobot, gravity_w: Array, continuous_Nm: Array, findings: Findings
) -> None:
    """Every gripper where its hold is, all of them off to one side."""
    off, turned, surface = known.hold_position_m, known.hold_yaw_rad, _surface_axes(samples)
    for x, y, yaw in product(sorted({off, -off}), sorted({off, -off}), sorted({turned, -turned})):
        moved = replace(
            samples,
            gripper_position=samples.gripper_position + x * surface[:, :, 0] + y * surface[:, :, 1],
            gripper_yaw=samples.gripper_yaw + yaw,
        )
        there = Findings()
        check_kinematics(moved, model, gravity_w, continuous_Nm, there)
        moved_by = f"hold {1e3 * x:+.0f}, {1e3 * y:+.0f} mm and {np.degrees(yaw):+.1f} degrees off"
        for each in dict.fromkeys([*there.worst(), *there.violations]):
            if each.constraint not in _REACH:
                continue
            where: dict[str, Any] = {"time_s": each.time_s, "detail": f"{moved_by} {each.detail}".rstrip()}
            if each.limb is not None:
                where |= {"limb": LIMB_NAMES.index(each.limb), "joint": each.joint}
            findings.add(f"{each.constraint}_uncertain", each.amount, each.unit, **where)
