"""A checker of one's own: do the forces of a plan carry the robot, and can its fingers bear them?

python examples/own_checker.py out/plan.mcap

Two of the constraints that `crux check` looks at, at the knots alone and for grippers on holds: (8a) with the robot at
rest, and (2) and (3) without the twist. Written against the plan's messages only: msgs/lcm says what they hold.
"""

import argparse
import math

import numpy as np
from crux_contracts.plan_file import read_plan
from crux_contracts.robot import load_robot
from crux_msgs import limb_knot_t, plan_t


def unbalanced_N(plan: plan_t, mass_kg: float) -> float:
    """The largest force that is left of contact forces and weight at a knot."""
    forces_N = np.array([[limb.finger_force_w_n for limb in knot.limbs] for knot in plan.knots])
    sums_N = forces_N.reshape(len(plan.knots), -1, 3).sum(axis=1)
    return float(np.linalg.norm(sums_N + mass_kg * np.array(plan.gravity_w_m_s2), axis=1).max())


def grip_margin_N(plan: plan_t, limb: limb_knot_t) -> float:
    """Friction times normal force, less the shear that is left to it when spines bear their share; the worse finger."""
    hold = plan.holds[limb.hold]
    margins = []
    for finger in (0, 1):
        face = limb.finger1_face ^ finger  # +x 0, -x 1, +y 2, -y 3: the second finger is on the opposite one
        angle = hold.yaw_rad + (face // 2) * math.pi / 2
        outward = np.array([math.cos(angle), math.sin(angle), 0.0]) * (-1 if face % 2 else 1)
        force_N = np.array(limb.finger_force_w_n[3 * finger : 3 * finger + 3])
        normal_N = float(outward @ force_N)  # what the face gives back to the robot
        shear_N = np.array([np.cross([0, 0, 1], outward) @ force_N, force_N[2]])
        spines_N = plan.spine_shear_n if hold.spines[face] else 0.0
        left_N = np.maximum(np.abs(shear_N) - spines_N, 0.0)
        margins.append(hold.friction[face] * normal_N - float(np.linalg.norm(left_N)))
    return min(margins)


def main(words: list[str] | None = None) -> bool:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plan")
    plan = read_plan(parser.parse_args(words).plan)
    robot = load_robot(plan.robot_name)
    unbalanced = unbalanced_N(plan, robot.total_mass_kg)
    margin = min(grip_margin_N(plan, limb) for knot in plan.knots for limb in knot.limbs if limb.hold >= 0)
    print(f"{plan.scenario_name}: unbalanced force {unbalanced:.3f} N at most, least grip margin {margin:.2f} N")
    return unbalanced < 0.5 and margin >= 0


if __name__ == "__main__":
    raise SystemExit(0 if main() else 1)
