"""Plans a wall again and again, with less friction each time, until no plan is left.

python examples/plan_a_wall.py msgs/scenarios/climb-four-holds.yaml
"""

import argparse
from pathlib import Path

import crux_planner
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, ScenarioError, parse_scenario
from crux_contracts.scenario_document import scenario_document


def with_friction(text: str, factor: float) -> Scenario:
    """The same wall, all faces of its holds `factor` times as rough."""
    wall = scenario_document(text)
    for hold in wall["holds"]:
        of = hold["friction"]
        hold["friction"] = {face: factor * mu for face, mu in of.items()} if isinstance(of, dict) else factor * of
    return parse_scenario(wall)


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--factors", type=float, nargs="+", default=[1.0, 0.7, 0.4, 0.1])
    given = parser.parse_args(words)

    text = given.scenario.read_text(encoding="utf-8")
    robot = load_robot(parse_scenario(text).robot)
    print("friction  steps   cost  least margin  gait")
    for factor in given.factors:
        try:
            result = crux_planner.plan(with_friction(text, factor), robot)
        except (crux_planner.InfeasibleError, ScenarioError) as error:  # the latter: it cannot even hang at the start
            print(f"{factor:8.2f}  no plan: {error}")
            break
        steps, margin_N = len(result.plan.knots) - 1, result.check.friction_margin_N
        print(f"{factor:8.2f}  {steps:5d}  {result.cost:5.2f}  {margin_N:10.2f} N  {' '.join(result.gait)}")


if __name__ == "__main__":
    main()
