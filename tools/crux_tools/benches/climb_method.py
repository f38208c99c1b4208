"""One of the paper's ADMMs run on a climb by itself, with what the independent checker says of the result."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario
from crux_planner.admm.methods import METHODS, Decided, Task
from crux_planner.build import build_problem
from crux_planner.checker import CheckReport, check_plan
from crux_planner.result import plan_message
from crux_planner.search.balance import Balance
from crux_planner.search.stances import Reach
from crux_planner.search.ways import Ways

LIMIT_S = 300.0


@dataclass(frozen=True)
class Alone:
    """What a method reached before the exact NLP, as a plan, and the checker's verdict on it."""

    decided: Decided
    plan: Any  # crux_msgs.plan_t
    check: CheckReport


def run_alone(scenario: Scenario, method: str, **settings: Any) -> Alone:
    """Run `method`; `settings` as `crux_planner.admm.methods.Task` has them. Raises InfeasibleError."""
    robot = load_robot(scenario.robot)
    problem = build_problem(scenario, robot)
    balance = Balance(problem, problem.friction_share)
    task = Task(problem, balance, Reach(problem), Ways(problem), time.monotonic() + LIMIT_S, **settings)
    decided = METHODS[method](task)
    plan = plan_message(scenario, robot, problem, decided.schedule, decided.solution, method)
    return Alone(decided, plan, check_plan(plan, robot))
