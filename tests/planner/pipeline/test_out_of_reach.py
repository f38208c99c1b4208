"""Nothing is said to be out of a limb's reach that joint limits allow: holds at random, with Pinocchio as referee."""

from __future__ import annotations

import copy
import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, ScenarioError
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.errors import PLANNED_REACH, InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import inverse, rotation_from_rpy, rotation_z
from crux_planner.model.problem import Pose, Problem
from crux_planner.pipeline.explanation import check_start, explain
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.stances import Oracles, SearchReport
from walls import FEET, scenario, two_rows

ROBOT = load_robot("scaler")
CLAIM = re.compile(r"out of reach|within reach|outside")  # said of a limb, not of what crux plans with
LIMB = 0


@pytest.fixture(scope="module")
def model() -> pin.Model:
    return pin.buildModelFromUrdf(str(ROBOT.urdf_path))


def reaches(model: pin.Model, problem: Problem, body: Pose, hold: str) -> bool:
    """Whether the first limb gets a gripper to the middle of a hold's faces within the limits that the URDF has."""
    limb, data = ROBOT.limbs[LIMB], model.createData()
    turn = rotation_from_rpy(body.rpy_rad)
    for contact in problem.contacts:
        if problem.hold_names[contact.hold] != hold:
            continue
        place, upright = turn.T @ (contact.centre_h_m - body.position_m), turn.T @ rotation_z(contact.yaw_rad)
        q, _ = inverse(limb, place, upright)
        full = pin.neutral(model)
        at = [model.joints[model.getJointId(name)].idx_q for name in limb.joint_names]
        full[at] = q
        pin.framesForwardKinematics(model, data, full)
        found = data.oMf[model.getFrameId(limb.gripper_link)]
        there = np.abs(found.translation - place).max() < 1e-6 and np.abs(found.rotation - upright).max() < 1e-6
        if there and (q >= model.lowerPositionLimit[at]).all() and (q <= model.upperPositionLimit[at]).all():
            return True
    return False


def somewhere(random: np.random.Generator, near: tuple[float, float]) -> list[float]:
    """A place off one, mostly where limbs just reach or just do not."""
    angle, far = random.uniform(-np.pi, np.pi), random.uniform(0.05, 0.35)
    return [round(float(near[0] + far * np.cos(angle)), 4), round(float(near[1] + far * np.sin(angle)), 4)]


def is_claim(said: str) -> bool:
    return CLAIM.search(said.replace(f"within {PLANNED_REACH}", "").replace(PLANNED_REACH, "")) is not None


def test_a_start_is_out_of_reach_just_where_joint_limits_end(model: pin.Model) -> None:
    random, counted = np.random.default_rng(1), {"refused": 0, "fine": 0}
    for _ in range(24):
        wall = two_rows()
        wall["holds"] = [part for part in wall["holds"] if part["name"] != "LF-high"]
        wall["holds"][0] |= {"position_m": somewhere(random, FEET["LF"]), "yaw_deg": float(random.uniform(-30, 30))}
        wall["start"]["body"]["rpy_deg"] = random.uniform(-4, 4, 3).round(2).tolist()
        wall["goal"] = {"body": {"position_m": [0.02, 0.0, 0.185]}}
        try:
            read = scenario(wall)
            problem = build_problem(read, ROBOT)
        except (ScenarioError, InfeasibleError):
            continue
        said = is_claim(refusal(read, problem))
        assert said is not reaches(model, problem, problem.start, "LF-low")
        counted["refused" if said else "fine"] += 1
    assert min(counted.values()) >= 3, counted


def refusal(read: Scenario, problem: Problem) -> str:
    try:
        check_start(read, problem, StaticEquilibrium(problem, problem.friction_share))
    except ScenarioError as error:
        text = str(error)
        return text if ".LF." in text else ""
    return ""


def test_a_goal_is_out_of_reach_only_where_joint_limits_end(model: pin.Model) -> None:
    """By what the search says, of a level body, and by what proofs say."""
    random, counted = np.random.default_rng(2), {"claimed": 0, "planned": 0}
    for _ in range(12):
        wall: dict[str, Any] = copy.deepcopy(two_rows())
        ahead = float(random.uniform(0.05, 0.15))
        wall["holds"] = [part for part in wall["holds"] if part["name"] != "LF-high"]
        wall["holds"].append({**wall["holds"][0], "name": "LF-high"})
        wall["holds"][-1]["position_m"] = somewhere(random, (FEET["LF"][0] + ahead, FEET["LF"][1]))
        wall["goal"] = {"body": {"position_m": [ahead, 0.0, 0.185], "tolerance_m": 0.001, "tolerance_deg": 0.1}}
        wall["goal"]["grasps"] = {"LF": {"hold": "LF-high", "faces": "x"}}
        try:
            read = scenario(wall)
            problem = build_problem(read, ROBOT)
        except (ScenarioError, InfeasibleError):
            continue
        reached = reaches(model, problem, problem.goal.body, "LF-high")
        shown, unfound = Proof(read, ROBOT, problem).quick(), explain(Oracles.of(problem), SearchReport(), 1)
        for said in (str(shown or ""), str(unfound)):
            if is_claim(said) and LIMB_NAMES[LIMB] in said:
                counted["claimed"] += 1
                assert not reached, said
        counted["planned"] += reached and PLANNED_REACH in str(unfound)
    assert min(counted.values()) >= 2, counted
