"""Start and goal: where the scenario wants the robot at the first and at the last knot, and which holds it grips."""

import math

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import BodyPose, Grasp, Scenario

from crux_planner.checker.geometry import Array, rotation_from_rpy, rotation_vector
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings


def check_ends(plan: PlanArrays, scenario: Scenario, findings: Findings) -> None:
    """The start is met exactly, at rest; the goal within its tolerances (distance and angle of the one rotation)."""
    start, goal = scenario.start, scenario.goal
    first, last = plan.time_s[0], plan.time_s[-1]
    off = float(np.linalg.norm(plan.body_position[0] - start.body.position_m))
    findings.add("start_position", off, "m", time_s=first)
    turned = _angle(plan.body_rpy[0], start.body)
    findings.add("start_orientation", turned, "rad", time_s=first)
    moving = float(np.abs(np.concatenate([plan.body_velocity[0], plan.body_rate[0]])).max())
    findings.add("start_at_rest", moving, "m/s or rad/s", time_s=first)
    for name, xy in start.feet.items():
        limb = LIMB_NAMES.index(name)
        away = float(np.linalg.norm(plan.gripper_position[0, limb, :2] - xy)) if plan.stance[0, limb] else 1.0
        findings.add("start_grasp", away, "m", limb=limb, time_s=first)
    _check_grasps("start_grasp", plan, 0, start.grasps, findings)
    for name, gripper in start.air.items():
        limb = LIMB_NAMES.index(name)
        detail = f"{name} should be in the air" if plan.stance[0, limb] else ""
        here = np.append(plan.gripper_position[0, limb], plan.separation[0, limb] / 2)
        away = 1.0 if detail else float(np.abs(here - [*gripper.position_m, gripper.opening_m]).max())
        findings.add("start_air", away, "m", limb=limb, time_s=first, detail=detail)
        turned = math.remainder(plan.gripper_yaw[0, limb] - gripper.yaw_rad, 2 * math.pi)
        turned = max(abs(turned), float(np.abs(plan.gripper_tilt[0, limb]).max()))
        findings.add("start_air", turned, "rad", limb=limb, time_s=first)

    off = float(np.linalg.norm(plan.body_position[-1] - goal.body.position_m))
    findings.add("goal_position", off - goal.tolerance_m, "m", time_s=last)
    turned = _angle(plan.body_rpy[-1], goal.body)
    findings.add("goal_orientation", turned - goal.tolerance_rad, "rad", time_s=last)
    _check_grasps("goal_grasp", plan, -1, goal.grasps, findings)


def _check_grasps(constraint: str, plan: PlanArrays, knot: int, grasps: dict[str, Grasp], findings: Findings) -> None:
    for name, grasp in grasps.items():
        limb = LIMB_NAMES.index(name)
        hold, face = int(plan.hold[knot, limb]), int(plan.finger1_face[knot, limb])
        if grasp.foothold:
            met = bool(plan.standing[knot, limb]) and plan.place_names[hold] == grasp.foothold
            detail = "" if met else f"{name} should stand on {grasp.foothold!r}, not on hold {hold} by face {face}"
            findings.add(constraint, float(not met), "", limb=limb, time_s=float(plan.time_s[knot]), detail=detail)
            continue
        under = {0: "+x", 1: "-x", 2: "+y", 3: "-y"}.get(face, "")
        met = plan.gripped[knot, limb] and plan.cuboids.names[hold] == grasp.hold and under[1:] == grasp.faces
        wanted = f"{grasp.hold!r} by faces {grasp.faces}"
        if grasp.finger1 is not None:
            met = met and under == grasp.finger1
            wanted += f", finger 1 on {grasp.finger1}"
        detail = "" if met else f"{name} should grip {wanted}, not hold {hold} by face {face}"
        findings.add(constraint, 0.0 if met else 1.0, "", limb=limb, time_s=float(plan.time_s[knot]), detail=detail)


def _angle(rpy: Array, wanted: BodyPose) -> float:
    other = rotation_from_rpy(np.array(wanted.rpy_rad))
    return float(np.linalg.norm(rotation_vector(rotation_from_rpy(rpy).T @ other)))
