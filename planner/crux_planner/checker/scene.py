"""Whose plan this is: its hashes, the scenario inside, what that fixes, and that the plan's copies of it are true."""

import hashlib
from functools import lru_cache
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Hold, Scenario, ScenarioError, parse_scenario

from crux_planner.checker import tolerances
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings


def check_identity(plan: Any, robot: Robot, findings: Findings) -> None:
    """plan_id, if there is one, is the SHA-256 of the message encoded without; robot and scenario hashes match."""
    given = plan.plan_id
    try:
        plan.plan_id = ""
        actual = hashlib.sha256(plan.encode()).hexdigest()
    except Exception as error:  # the generated encoder raises whatever the wrong field makes it raise
        findings.add("plan_format", 1.0, "", detail=f"cannot be encoded: {error}")
        return
    finally:
        plan.plan_id = given
    scenario = hashlib.sha256(plan.scenario_yaml.encode("utf-8")).hexdigest()
    for name, carried, computed, what in (
        ("plan_id", given, actual, "the plan itself"),
        ("robot_hash", plan.robot_sha256, robot.hash, f"the robot description {robot.name!r}"),
        ("scenario_hash", plan.scenario_sha256, scenario, "the scenario text in the plan"),
    ):
        differs = carried != computed and (name != "plan_id" or carried != "")
        detail = f"carries {carried[:12] or 'none'}…, {what} has {computed[:12]}…" if differs else ""
        findings.add(name, float(differs), "", detail=detail)


def read_scene(plan: Any, arrays: PlanArrays, findings: Findings) -> Scenario | None:
    """The scenario of a crux_msgs.plan_t, its copies compared; None after reporting why its text cannot be used."""
    try:
        scenario = _scenario(plan.scenario_yaml)
    except ScenarioError as error:
        findings.add("scenario", 1.0, "", detail=str(error))
        return None
    findings.add("scenario", 0.0, "")
    return scenario if _compare(plan, arrays, scenario, findings) else None


@lru_cache(maxsize=4)  # plans made for one scenario are checked one after the other
def _scenario(text: str) -> Scenario:
    return parse_scenario(text, "the scenario in the plan")


def _compare(plan: Any, arrays: PlanArrays, scenario: Scenario, findings: Findings) -> bool:
    """Compare all copies; False where the plan has other cuboids than the scenario, so that indices mean nothing."""
    contact = scenario.contact
    point = contact.model == "point"
    pairs: list[tuple[str, Any, Any]] = [
        ("dt_s", plan.dt_s, scenario.horizon.dt_s),
        ("gravity", plan.gravity_w_m_s2, scenario.wall.gravity_w_m_s2),
        ("k of the limit surface", plan.patch_k_m, 0.0 if point else contact.patch_k_m),
        ("spine shear", plan.spine_shear_n, contact.spine_shear_N),
        ("spine twist", plan.spine_twist_nm, contact.spine_twist_Nm),
        ("goal tolerance", plan.goal_tolerance_m, scenario.goal.tolerance_m),
        ("goal tolerance in angle", plan.goal_tolerance_rad, scenario.goal.tolerance_rad),
    ]
    most = scenario.horizon.steps + 1
    fewest = most if scenario.planner.idle == "keep" else 1
    pairs.append(("number of knots", plan.n_knots, min(max(plan.n_knots, fewest), most)))
    for what, planned, wanted in pairs:
        _match(what, planned, wanted, findings)
    above = plan.max_normal_n - contact.max_normal_N
    findings.add("normal_force_bound", above, "N", tolerance=tolerances.MATCH_REL, detail="above the scenario's")
    texts = ("name", plan.scenario_name, scenario.name), ("robot", plan.robot_name, scenario.robot)
    for what, text, wanted_text in texts:
        same = text == wanted_text
        detail = "" if same else f"{what} is {text!r} in the plan, {wanted_text!r} in the scenario"
        findings.add("scenario_match", float(not same), "", detail=detail)
    names = tuple(cuboid.name for cuboid in scenario.cuboids)
    if arrays.cuboids.names != names:
        detail = f"holds {list(arrays.cuboids.names)} in the plan, {list(names)} in the scenario"
        findings.add("scenario_match", 1.0, "", detail=detail)
        return False
    for index, cuboid in enumerate(scenario.cuboids):
        copy, label = arrays.cuboids, f"hold {cuboid.name!r}"
        graspable = isinstance(cuboid, Hold)
        _match(f"{label}: graspable", float(copy.graspable[index]), float(graspable), findings)
        _match(f"{label}: position", copy.foot_w_m[index], (*cuboid.position_m, cuboid.foot_z_m), findings)
        _match(f"{label}: size", copy.size_m[index], cuboid.size_m, findings)
        _match(f"{label}: yaw", copy.yaw_rad[index], cuboid.yaw_rad, findings)
        _match(f"{label}: roll and pitch", copy.tilt_rad[index], cuboid.tilt_rad, findings)
        if isinstance(cuboid, Hold):
            _match(f"{label}: friction", copy.friction[index], cuboid.friction, findings)
            _match(f"{label}: spines", copy.spines[index].astype(float), np.array(cuboid.spines, float), findings)
        leans = cuboid.lean_rad if isinstance(cuboid, Hold) else (0.0,) * 4
        _match(f"{label}: lean of its faces", copy.lean_rad[index], leans, findings)
    return True


def _match(what: str, planned: Any, wanted: Any, findings: Findings) -> None:
    a, b = np.asarray(planned, dtype=float), np.asarray(wanted, dtype=float)
    off = float(np.abs(a - b).max()) if a.shape == b.shape else 1.0
    tolerance = tolerances.MATCH_REL * max(1.0, float(np.abs(b).max()))
    detail = f"{what} is {a.tolist()} in the plan, {b.tolist()} in the scenario" if off > tolerance else ""
    findings.add("scenario_match", off, "", tolerance=tolerance, detail=detail)
