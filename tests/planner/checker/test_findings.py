"""What the checker finds, to the last digits: on a plan that passes and on plans spoilt in every part.

The numbers were written by a checker that measured every part against every other at every sample. To write them again
after a change of the robot or of a constraint: in tests/planner, `python -m checker.test_findings`.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_planner.checker import CheckReport, Violation, check_plan

from . import synthetic

ROBOT = load_robot("scaler")
FILE = Path(__file__).with_name("findings.json")
SEEDS = range(8)
SAME = 1e-7  # of an amount: rounding, and where an iteration ends


def spoilt(seed: int) -> Any:
    """The plan that passes for seed 0, else with a few fields moved over a few knots."""
    plan, random = copy.deepcopy(synthetic.make_plan()), np.random.default_rng(seed)
    for _ in range(3 if seed else 0):
        first = int(random.integers(len(plan.knots)))
        limb, kind, axis = int(random.integers(4)), int(random.integers(7)), int(random.integers(3))
        by = float(random.choice([-1, 1]) * random.choice([0.003, 0.03, 0.3]))
        for knot in plan.knots[first : first + int(random.integers(1, 6))]:
            grasp = knot.limbs[limb]
            if kind == 5:
                grasp.gripper_yaw_w_rad += 3 * by
            elif kind == 6:
                grasp.finger_separation_m += by
            else:
                owner, name, scale = (
                    (knot, "body_position_w_m", 1.0),
                    (knot, "body_rpy_rad", 2.0),
                    (grasp, "gripper_position_w_m", 1.0),
                    (grasp, "finger_force_w_n", 500.0),
                    (grasp, "finger_moment_w_nm", 5.0),
                )[kind]
                values = list(getattr(owner, name))
                values[axis] += scale * by
                setattr(owner, name, values)
    return synthetic.sign(plan)


def found(report: CheckReport) -> dict[str, Any]:
    def row(v: Violation) -> list[Any]:
        return [v.constraint, v.limb, v.finger, v.time_s, v.amount, v.detail]

    return {
        "violations": [row(v) for v in report.violations],
        "worst": sorted(row(v) for v in report.worst),
        "margins": [report.friction_margin_N, report.tumble_margin_m],
        "joints": [[j.peak_torque_Nm, j.rms_torque_Nm, j.peak_speed_rad_s] for j in report.joints],
    }


def is_same(row: list[Any], wanted: list[Any]) -> bool:
    """The same constraint by the same amount; place and time may differ between equals."""
    return row[:1] == wanted[:1] and row[4] == pytest.approx(wanted[4], rel=SAME, abs=SAME)


@pytest.mark.parametrize("seed", SEEDS)
def test_findings_are_those_on_record(seed: int) -> None:
    wanted = json.loads(FILE.read_text())[seed]
    actual = found(check_plan(spoilt(seed), ROBOT))
    assert len(actual["violations"]) == len(wanted["violations"])
    for row, other in zip(actual["violations"], wanted["violations"], strict=True):
        assert is_same(row, other), (row, other)
        assert row[1:4] + row[5:] == other[1:4] + other[5:]
    for row, other in zip(actual["worst"], wanted["worst"], strict=True):
        assert is_same(row, other), (row, other)
    np.testing.assert_allclose(actual["joints"], wanted["joints"], rtol=SAME, atol=SAME)
    assert actual["margins"] == pytest.approx(wanted["margins"], rel=SAME)


if __name__ == "__main__":
    records = [found(check_plan(spoilt(seed), ROBOT)) for seed in SEEDS]
    FILE.write_text("[\n" + ",\n".join(json.dumps(record) for record in records) + "\n]\n")
