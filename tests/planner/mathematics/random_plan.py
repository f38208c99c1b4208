"""A plan of random numbers on a wall of turned holds, in the planner's terms and read back from its message.

It is no plan that holds: every constraint has something left over, so that a residual cannot be right by being zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import yaml
from checker import synthetic
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import Scenario, parse_scenario
from crux_planner.checker.plan_arrays import PlanArrays, read_plan
from crux_planner.checker.report import Findings
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.pipeline.message import plan_message
from crux_planner.trajectory.solution import Solution
from crux_tools.paths import ROOT

N, HEADING_DEG = 9, 20.0
Z = np.array([0.0, 0.0, 1.0])


def scene() -> Scenario:
    """`climb-turned` turned as a whole, so that the planner's frame is not W, with weights unlike one another."""
    content = yaml.safe_load((ROOT / "msgs" / "scenarios" / "climb-turned.yaml").read_text(encoding="utf-8"))
    turn = np.radians(HEADING_DEG)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for hold in content["holds"]:
        hold["position_m"] = (rotation @ hold["position_m"]).tolist()
        hold["yaw_deg"] = float(hold.get("yaw_deg", 0.0)) + HEADING_DEG
    for pose in (content["start"]["body"], content["goal"]["body"]):
        pose["position_m"][:2] = (rotation @ pose["position_m"][:2]).tolist()
        pose["rpy_deg"] = [*pose.get("rpy_deg", [0, 0, 0])[:2], pose.get("rpy_deg", [0, 0, 0])[2] + HEADING_DEG]
    weights = {"position": 1.7, "orientation": 0.6, "velocity": 8.0, "wrench": 3e-4}
    content["planner"] = {"weights": {**weights, "lift": 0.13, "opening": 0.21, "switching": 0.37}}
    content["horizon"]["steps"] = N
    return parse_scenario(yaml.safe_dump(content))


@dataclass(frozen=True)
class RandomPlan:
    """One draw."""

    scenario: Scenario
    robot: Robot
    problem: Problem
    schedule: Schedule
    solution: Solution
    arrays: PlanArrays  # of the message, its numbers moved a little once more

    @cached_property
    def air(self) -> np.ndarray:
        """(N + 1, 4) limbs in the air, as the schedule has it."""
        return np.array([[c is None for c in knot] for knot in self.schedule.contacts])

    @cached_property
    def opening_axis(self) -> np.ndarray:
        """e_l, (N + 1, 4, 3)."""
        yaw = self.arrays.gripper_yaw
        return np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)

    @cached_property
    def fingers(self) -> np.ndarray:
        """p_i by (9b), (N + 1, 4, 2, 3)."""
        half = self.arrays.separation[..., None] / 2 * self.opening_axis
        return np.stack([self.arrays.gripper_position + half, self.arrays.gripper_position - half], axis=2)

    @cached_property
    def centre_of_mass(self) -> np.ndarray:
        """r_M at knots 0 .. N - 1 (N, 3): pinocchio's, with its own inverse kinematics."""
        plan, found = self.arrays, []
        for k in range(N):
            limbs = [
                SimpleNamespace(
                    gripper_position_w_m=plan.gripper_position[k, limb],
                    gripper_yaw_w_rad=plan.gripper_yaw[k, limb],
                    finger_separation_m=plan.separation[k, limb],
                )
                for limb in range(4)
            ]
            pose = {"body_position_w_m": plan.body_position[k], "body_rpy_rad": plan.body_rpy[k]}
            found.append(synthetic.centre_of_mass(SimpleNamespace(**pose, limbs=limbs)))
        return np.array(found)

    @cached_property
    def face_axes(self) -> np.ndarray:
        """x, y and z of the faces under the fingers by the notation table, (N + 1, 4, 2, 3, 3); zero in the air."""
        axes, plan = np.zeros((N + 1, 4, 2, 3, 3)), self.arrays
        for k, limb in np.argwhere(~self.air):
            hold, face = plan.hold[k, limb], plan.finger1_face[k, limb]
            angle = plan.cuboids.yaw_rad[hold] + (0, np.pi, np.pi / 2, -np.pi / 2)[face]
            outward = np.array([np.cos(angle), np.sin(angle), 0.0])
            for finger, normal in enumerate((outward, -outward)):
                axes[k, limb, finger] = [np.cross(Z, outward), Z, normal]
        return axes

    @cached_property
    def local(self) -> tuple[np.ndarray, np.ndarray]:
        """f (N + 1, 4, 2, 3) and the twists m^z (N + 1, 4, 2) by (13)."""
        force = np.einsum("klfij,klfj->klfi", self.face_axes, self.arrays.finger_force)
        twist = np.einsum("klj,klfj->klf", self.face_axes[:, :, 0, 2], self.arrays.finger_moment)
        return force, twist


def draw(seed: int) -> RandomPlan:
    """Every limb swings once, from one contact to another."""
    random, scenario, robot = np.random.default_rng(seed), scene(), load_robot("scaler")
    problem = build_problem(scenario, robot)
    contacts: list[list[int | None]] = [[None] * 4 for _ in range(N + 1)]
    poses = np.zeros((N + 1, 4, 5))
    for limb in range(4):
        reached = [c for c in problem.limb_contacts[limb] if _reaches(problem, limb, c)]
        first, last = (int(c) for c in random.choice(reached, 2))
        lift_off = int(random.integers(1, N - 3))
        touch_down = int(random.integers(lift_off + 2, N))  # all grip at knot N - 1
        for k in range(N + 1):
            held = first if k < lift_off else last if k >= touch_down else None
            contacts[k][limb] = held
            old, new = (problem.contacts[c].pose for c in (first, last))
            swung = old + random.uniform() * (new - old) + random.normal(size=5) * [0.01, 0.01, 0.0, 0.1, 0.002]
            swung[2] += random.uniform(0.02, 0.05)
            poses[k, limb] = problem.contacts[held].pose if held is not None else swung
    schedule = Schedule([], contacts, poses)
    pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad])
    body = np.hstack([pose, np.zeros(6)]) + random.normal(size=(N + 1, 12)) * np.repeat([0.01, 0.03, 0.02, 0.1], 3)
    least = np.array([-10.0, -10.0, -0.1, 1.0, 1.0])
    wrenches = [
        {
            limb: random.uniform(least, [10.0, 10.0, 0.1, 40.0, 40.0])
            for limb in range(4)
            if contacts[k][limb] is not None
        }
        for k in range(N)
    ]
    solution = Solution(body, wrenches, 0.0, 0, "", True, 0.0, 0.0, {}, problem.torque_limits_Nm)
    message = plan_message(scenario, robot, problem, schedule, solution)
    _spoil(message, random)
    arrays = read_plan(message, Findings())
    assert arrays is not None
    return RandomPlan(scenario, robot, problem, schedule, solution, arrays)


def _reaches(problem: Problem, limb: int, contact: int) -> bool:
    """From where the body starts."""
    away = problem.contacts[contact].centre_h_m - problem.start.position_m
    return bool((problem.limb_reach.inner.beyond(limb, away) <= 0.0).all())


def _spoil(message: Any, random: np.random.Generator) -> None:
    """Fingers that share no shear and no twist, off their faces, loaded in the air."""
    for knot in message.knots:
        for limb in knot.limbs:
            limb.gripper_position_w_m = (np.array(limb.gripper_position_w_m) + random.normal(size=3) * 0.01).tolist()
            limb.finger_separation_m += float(random.uniform(0.0, 0.01))
            limb.finger_force_w_n = (np.array(limb.finger_force_w_n) + random.normal(size=6)).tolist()
            limb.finger_moment_w_nm = (np.array(limb.finger_moment_w_nm) + random.normal(size=6) * 0.01).tolist()
