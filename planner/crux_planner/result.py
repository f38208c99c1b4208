"""From a solution to the plan message (crux_msgs.plan_t), turned back from the heading frame to W."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import crux_msgs
import numpy as np
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import Robot
from crux_contracts.scenario import Hold, Scenario

from crux_planner.arrays import Array
from crux_planner.kinematics import rotation_z

if TYPE_CHECKING:
    from crux_planner.nlp import Solution
    from crux_planner.problem import Problem
    from crux_planner.search.schedule import Schedule


@dataclass
class PlanResult:
    """What `crux_planner.plan` gives back; `ok` means that the plan passed the check."""

    ok: bool
    plan: Any  # crux_msgs.plan_t
    check: Any  # crux_planner.checker.CheckReport
    cost: float
    iterations: int
    gait: list[str]
    position_residual_m: float
    force_residual_N: float
    method: str = "auto"
    seconds: float = 0.0
    gap: float | None = None
    history: list[dict[str, float]] = field(default_factory=list)  # ADMM residuals, iteration by iteration
    alone: dict[str, Any] | None = None  # what a method reached before the exact NLP
    timing: dict[str, float] = field(default_factory=dict)

    @property
    def residuals(self) -> dict[str, float]:
        """Of the consensus where the method is an ADMM, else of the exact NLP's dynamics."""
        if self.history:
            return self.history[-1]
        return {"position_m": self.position_residual_m, "force_N": self.force_residual_N}

    def to_json(self) -> dict[str, Any]:
        """The object `crux plan --json` prints."""
        return {
            "ok": self.ok,
            "method": self.method,
            "seconds": round(self.seconds, 3),
            "cost": self.cost,
            "gap": self.gap,
            "iterations": self.iterations,
            "residuals": self.residuals,
            "history": self.history,
            "alone": self.alone,
            "gait": self.gait,
            "check": {"ok": self.check.ok, "worst": self.check.to_json()["worst"]},
            "timing": self.timing,
        }


def plan_message(
    scenario: Scenario, robot: Robot, problem: Problem, schedule: Schedule, solution: Solution, method: str = "auto"
) -> Any:
    """The plan as a message, complete with its plan_id."""
    plan = plan_header(scenario, robot, solution.cost, method)
    plan.patch_k_m = problem.patch.k_m
    plan.max_normal_n = problem.patch.max_normal_N
    plan.spine_shear_n = problem.patch.spine_shear_N
    plan.spine_twist_nm = problem.patch.spine_twist_Nm
    plan.knots = [_knot(problem, schedule, solution, k) for k in range(problem.steps + 1)]
    plan.n_knots = len(plan.knots)
    plan.plan_id = plan_id(plan)
    return plan


def plan_header(scenario: Scenario, robot: Robot, cost: float, method: str = "auto") -> Any:
    """A plan_t with all that does not depend on the contact model: names, hashes, gravity, goal tolerances, cuboids."""
    plan = crux_msgs.plan_t()
    plan.format = crux_msgs.plan_t.FORMAT
    plan.scenario_name = scenario.name
    plan.scenario_yaml = scenario.yaml_text
    plan.scenario_sha256 = scenario.sha256
    plan.robot_name = robot.name
    plan.robot_sha256 = robot.hash
    plan.method = method
    plan.cost = cost
    plan.dt_s = scenario.horizon.dt_s
    plan.gravity_w_m_s2 = list(scenario.wall.gravity_w_m_s2)
    plan.goal_tolerance_m = scenario.goal.tolerance_m
    plan.goal_tolerance_rad = scenario.goal.tolerance_rad
    plan.holds = [_hold(cuboid) for cuboid in scenario.cuboids]
    plan.n_holds = len(plan.holds)
    return plan


def _hold(cuboid: Any) -> Any:
    hold = crux_msgs.hold_t()
    graspable = isinstance(cuboid, Hold)
    hold.name = cuboid.name
    hold.graspable = int(graspable)
    hold.position_w_m = [*cuboid.position_m, 0.0]
    hold.size_m = list(cuboid.size_m)
    hold.yaw_rad = cuboid.yaw_rad
    hold.friction = list(cuboid.friction) if graspable else [0.0] * 5
    hold.spines = [int(s) for s in cuboid.spines] if graspable else [0] * 5
    return hold


def _knot(problem: Problem, schedule: Schedule, solution: Solution, k: int) -> Any:
    to_w, heading = rotation_z(problem.heading_rad), np.array([0.0, 0.0, problem.heading_rad])
    state = solution.body[k]
    knot = crux_msgs.plan_knot_t()
    knot.time_s = k * problem.dt_s
    knot.body_position_w_m = list(to_w @ state[0:3])
    knot.body_rpy_rad = list(state[3:6] + heading)
    knot.body_velocity_w_m_s = list(to_w @ state[6:9])
    knot.body_angular_velocity_b_rad_s = list(state[9:12])
    knot.limbs = [_limb(problem, schedule, solution, k, limb, to_w) for limb in range(4)]
    return knot


def _limb(problem: Problem, schedule: Schedule, solution: Solution, k: int, limb: int, to_w: Array) -> Any:
    message = crux_msgs.limb_knot_t()
    pose = schedule.poses[k, limb]
    message.gripper_position_w_m = list(to_w @ pose[:3])
    message.gripper_yaw_w_rad = float(pose[3]) + problem.heading_rad
    message.finger_separation_m = 2 * float(pose[4])
    index = schedule.contacts[k][limb]
    if index is None:
        message.phase, message.hold = crux_msgs.limb_knot_t.AIR, -1
        message.finger1_face, message.friction = crux_msgs.limb_knot_t.FACE_NONE, 0.0
        message.finger_force_w_n, message.finger_moment_w_nm = [0.0] * 6, [0.0] * 6
        return message
    contact = problem.contacts[index]
    q = solution.wrenches[min(k, problem.steps - 1)][limb]  # the last knot repeats the one before
    from crux_planner.terms.limit_surface import finger_forces

    forces, moments = finger_forces(q, contact.axis, contact.tangent)
    message.phase, message.hold = crux_msgs.limb_knot_t.STANCE, contact.hold
    message.finger1_face, message.friction = contact.finger1_face, contact.friction
    message.finger_force_w_n = list((forces @ to_w.T).ravel())
    message.finger_moment_w_nm = list((moments @ to_w.T).ravel())
    return message
