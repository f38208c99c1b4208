"""Whose plan this is: the hash it carries of itself, the robot and the scenario it was made for."""

from __future__ import annotations

import hashlib
from typing import Any

from crux_contracts.robot import Robot

from crux_planner.checker.report import Findings


def check_identity(plan: Any, robot: Robot, findings: Findings) -> None:
    """plan_id is the SHA-256 of the message encoded with plan_id empty (unless the plan has not been given one yet);
    robot and scenario hashes match.
    """
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
