"""Independent checker of exact P1: shares no constraint code with the planner."""

from crux_planner.checker.check import check_plan
from crux_planner.checker.report import CheckReport, JointLoad, Violation

__all__ = ["CheckReport", "JointLoad", "Violation", "check_plan"]
