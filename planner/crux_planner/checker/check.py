"""The checker of exact P1: every constraint at every knot and between the knots, for the real robot."""

import time
from pathlib import Path

import numpy as np
from crux_contracts.robot import Robot, robot_of
from crux_contracts.scenario import Scenario, Uncertainty
from crux_msgs import plan_t

from crux_planner.checker.bounds import check_bounds
from crux_planner.checker.clearance import check_clearance
from crux_planner.checker.contact import check_contact
from crux_planner.checker.cost import cost
from crux_planner.checker.dynamics import centre_of_mass, check_dynamics, check_feet_press, net_wrench
from crux_planner.checker.equilibrium import (
    check_between_knots,
    check_torques,
    correction,
    shared_load,
    tumble_margin,
    within_cones,
)
from crux_planner.checker.feet import check_feet, on_surfaces
from crux_planner.checker.kinematics import check_kinematics
from crux_planner.checker.limb_clearance import check_limb_clearance
from crux_planner.checker.limb_model import load_model
from crux_planner.checker.limit_surface import check_limit_surface, finger_loads, pad_shares
from crux_planner.checker.pace import check_pace
from crux_planner.checker.parts import limb_parts, shapes
from crux_planner.checker.plan_arrays import PlanArrays, read_plan
from crux_planner.checker.report import CheckReport, Findings
from crux_planner.checker.sampling import on_pads, sample
from crux_planner.checker.scene import check_identity, read_scene
from crux_planner.checker.terminal import check_ends
from crux_planner.checker.uncertainty import check_uncertainty

FOOT_WINDOW = 0.5
"""Of a knot's interval: over so long a foot has to press in the mean. What is shorter its pads and joints soften."""


def check_plan(plan: plan_t, robot: Robot | str | Path) -> CheckReport:
    """Check a crux_msgs.plan_t against exact P1 for a robot (a shipped one's name, a robot's folder, or one that is
    read), from the plan alone: the scene is read from the scenario text inside it, and everything the plan copies from
    there is compared.

    A plan whose form does not allow the checks (wrong sizes, numbers that are not finite, a scenario that cannot be
    read) gets a report with that violation only.
    """
    robot, began = robot_of(robot), time.perf_counter()
    findings, report = Findings(), CheckReport()
    check_identity(plan, robot, findings)
    arrays = read_plan(plan, findings, robot.gripper.pad_radius_m)
    scenario = read_scene(plan, arrays, findings) if arrays is not None else None
    if arrays is not None and scenario is not None:
        _check(arrays, scenario, robot, findings, report)
    report.violations = findings.violations
    report.worst = findings.worst()
    report.seconds = time.perf_counter() - began
    return report


def _check(plan: PlanArrays, scenario: Scenario, robot: Robot, findings: Findings, report: CheckReport) -> None:
    """All checks that need a plan of sound form, a robot and a scenario."""
    model, point = load_model(robot), scenario.contact.model == "point"
    plan = on_surfaces(plan, scenario, robot, findings)
    paced = plan.own_times and scenario.planner.objective != "paper"
    check_bounds(plan, robot, point, paced, findings, endless=scenario.wall.endless)
    if paced:
        check_pace(plan, robot, findings)
    check_contact(plan, scenario, robot, findings)
    check_ends(plan, scenario, findings)
    report.cost = None if point else cost(plan, scenario)
    margins_N = check_limit_surface(plan, scenario, findings), check_feet(plan, scenario, findings)
    report.friction_margin_N = min((each for each in margins_N if each is not None), default=None)
    loads = finger_loads(plan, scenario.wall.friction, pad_shares(scenario))

    samples = feet = sample(plan)
    pad_radius_m = robot.gripper.pad_radius_m
    if point:
        samples = on_pads(samples, pad_radius_m)
    continuous_Nm = np.array(robot.servo.continuous_torque_Nm)
    found = check_kinematics(samples, model, plan.gravity_w, continuous_Nm, findings)
    motions, report.joints, report.actuators = found
    states = [motion.state for motion in motions]
    centre = centre_of_mass(samples, model, states)
    knots = np.searchsorted(samples.interval, np.arange(plan.n_knots - 1))
    check_dynamics(plan, centre[knots], model.mass_kg, model.inertia(states, 0), findings)
    report.tumble_margin_m = tumble_margin(plan, loads, centre[knots], model.mass_kg)
    if point:
        window_s = FOOT_WINDOW * plan.dt_s
        inertial = net_wrench(samples, model, states, plan.gravity_w, window_s)
        check_feet_press(feet, inertial, window_s, findings)
    net = (feet.force.sum(axis=1), np.zeros_like(centre)) if point else None
    shared, left = shared_load(feet, centre, net, robot.control.twist_length_m)
    if plan.standing.any():
        shared, left = within_cones(plan, feet, (shared, left), centre, robot.control.twist_length_m)
    report.correction = None if point else correction(feet, shared, centre)
    check_between_knots(plan, shared, left, loads, scenario, findings)
    shared = on_pads(shared, pad_radius_m) if point else shared
    report.largest_torque = check_torques(shared, motions, model, plan.gravity_w, findings)
    limbs = [limb_parts(samples, limb, i, motions[i], pad_radius_m) for i, limb in enumerate(model.limbs)]
    body = shapes("body", model.body, samples.body_position, samples.rotation)
    spare_m = 2**0.5 * scenario.uncertainty.hold_position_m if scenario.uncertainty else 0.0  # along x and y, each
    solids, wall = plan.cuboids.with_slabs(scenario.wall.slabs), scenario.wall
    check_clearance(
        samples, solids, limbs, body, endless=wall.endless, point_model=point, spare_m=spare_m, findings=findings
    )
    check_limb_clearance(samples, limbs, body, spare_m, findings)
    if scenario.uncertainty is not None and (unknown := _unknown(scenario, scenario.uncertainty)):
        findings.add("limit_surface_uncertain", 1.0, "", detail=f"no check knows what {unknown}")
    elif scenario.uncertainty is not None:
        check_uncertainty(plan, scenario, loads, robot, findings)


def _unknown(scenario: Scenario, known: Uncertainty) -> str:
    """What this check does not know of an uncertainty; empty where there is nothing."""
    if scenario.leans:
        return "an uncertainty makes of holds whose faces lean"
    at_angle = known.moves_holds and any(hold.tilted_grips for hold in scenario.holds)
    return "uncertain places make of grips at an angle" if at_angle else ""
