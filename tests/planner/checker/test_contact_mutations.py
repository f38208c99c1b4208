"""Contact model, dynamics and contacts: each constraint, broken by a known amount in the plan made by hand, is reported
with its name, limb, finger, time and amount.
"""

import copy

import numpy as np
import pytest
from crux_msgs import plan_t

from . import synthetic
from .broken import DT, LF, LR, RF, RR, VALID, E, T, add, broken, finger_force, move, only, push, the, twist

# ---- the contact model


def test_limit_surface_shear_and_twist_together() -> None:
    """Amount by (2a): (|(sx - 5, sy - 5)|^p + ((t - 0.05)/k)^p)^(1/p) - mu fz with this test's own numbers."""
    knot, limb = 4, LR
    force = finger_force(VALID, knot, limb, 2)
    moment = np.array(VALID.knots[knot].limbs[limb].finger_moment_w_nm[3:]) + 0.4 * E
    along, up, normal = abs(force @ T) + 30.0 * np.sign(abs(force @ T)), abs(force[2]), force @ -E
    shear, turn = np.hypot(max(along - 5.0, 0.0), max(up - 5.0, 0.0)), (abs(moment @ E) - 0.05) / synthetic.PATCH_K_M
    expected = float((shear**1.65 + turn**1.65) ** (1 / 1.65)) - 2.2 * normal

    def change(plan: plan_t) -> None:
        push(plan, knot, limb, 2, 30.0 * np.sign(force @ T) * T)
        twist(plan, knot, limb, 2, 0.4 * E)

    found = the(broken(change), "limit_surface", limb, 2, knot)
    assert expected > 1.0
    assert found.amount == pytest.approx(expected, abs=1e-9)


def test_friction_is_that_of_the_touched_face() -> None:
    """Finger 2 sits on the minus x face: ice there is ice for finger 2 alone, whatever limb_knot.friction says."""

    def change(plan: plan_t) -> None:
        plan.holds[2].friction = [2.2, 0.0, 2.2, 2.2, 2.2]
        plan.scenario_yaml = plan.scenario_yaml.replace(
            "friction: 2.2}\n  - {name: d", "friction: {+x: 2.2, -x: 0, +y: 2.2, -y: 2.2, top: 2.2}}\n  - {name: d"
        )

    report = broken(change)
    found = only(report, "limit_surface")
    assert {(v.limb, v.finger) for v in found} == {("LR", 2)}
    assert {(v.limb, v.amount) for v in only(report, "friction")} == {("LR", 2.2)}
    assert not [v for v in report.violations if v.constraint == "scenario_match"]


def test_spines_only_where_the_hold_has_them() -> None:
    force = np.abs([finger_force(VALID, 4, LR, 1) @ T, finger_force(VALID, 4, LR, 1)[2]])

    def change(plan: plan_t) -> None:
        plan.holds[2].spines = [0] * 5
        plan.holds[2].friction = [0.0] * 5

    report = broken(change)
    at_knot = [v for v in only(report, "limit_surface") if v.finger == 1]
    assert at_knot[0].amount >= np.linalg.norm(force) - 1e-6  # no spines, no friction: all of the shear is too much
    assert only(report, "scenario_match")


def test_a_face_without_friction_is_no_grasp() -> None:
    """Spines bear all that the plan asks for there, and still the runtime would not take it."""

    def change(plan: plan_t) -> None:
        plan.holds[2].friction = [2.2, 0.0, 2.2, 2.2, 2.2]
        plan.scenario_yaml = plan.scenario_yaml.replace(
            "friction: 2.2}\n  - {name: d", "friction: {+x: 2.2, -x: 0, +y: 2.2, -y: 2.2, top: 2.2}}\n  - {name: d"
        ).replace("spine_shear_N: 5", "spine_shear_N: 60")
        for knot in plan.knots:
            knot.limbs[LR].friction = 0.0

    found = only(broken(change), "hold")
    assert {(v.limb, v.detail) for v in found} == {
        ("LR", "a face in contact has friction 0, expected more: spines alone do not make a grasp")
    }


@pytest.mark.parametrize("finger", [1, 2])
def test_a_finger_that_hangs_by_its_spines_must_not_press(finger: int) -> None:
    """Amount: its normal force. Between the knots its partner's share of the pull is all there is: nothing squeezes."""

    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace(
            "spine_twist_Nm: 0.05}", f"spine_twist_Nm: 0.05, spines_only: {{RR: {finger}}}}}"
        )

    report = broken(change)
    found = only(report, "spines_only")
    normals = [finger_force(VALID, k, RR, finger) @ (E if finger == 1 else -E) for k in range(len(VALID.knots))]
    assert {(v.limb, v.finger) for v in found} == {("RR", finger)}
    assert max(v.amount for v in found) == pytest.approx(max(normals))
    assert {v.limb for v in only(report, "limit_surface_between_knots")} == {"RR"}


def test_normal_force_below_zero() -> None:
    normal = finger_force(VALID, 2, RR, 1) @ E
    found = the(broken(lambda p: push(p, 2, RR, 1, -(normal + 3.0) * E)), "normal_force_min", RR, 1, 2)
    assert found.amount == pytest.approx(3.0)


def test_normal_force_above_the_limit() -> None:
    normal = finger_force(VALID, 2, RR, 2) @ -E
    found = the(broken(lambda p: push(p, 2, RR, 2, (normal - 64.0) * E)), "normal_force_max", RR, 2, 2)
    assert found.amount == pytest.approx(4.0)


def test_moment_across_the_normal() -> None:
    found = the(broken(lambda p: twist(p, 2, LF, 1, 0.03 * T + 0.04 * np.array([0, 0, 1]))), "contact_moment", LF, 1, 2)
    assert found.amount == pytest.approx(0.05)


def test_unequal_shear_in_a_pair() -> None:
    found = the(broken(lambda p: push(p, 2, LF, 1, 0.5 * T)), "equal_shear", LF, None, 2)
    assert found.amount == pytest.approx(0.5)


def test_unequal_twist_in_a_pair() -> None:
    found = the(broken(lambda p: twist(p, 2, LF, 1, 0.01 * E)), "equal_twist", LF, None, 2)
    assert found.amount == pytest.approx(0.01)


# ---- dynamics


def test_forces_out_of_balance() -> None:
    found = the(broken(lambda p: push(p, 5, LF, 1, np.array([0.0, 0.0, 2.0]))), "force_balance", None, None, 5)
    assert found.amount == pytest.approx(2.0)


def test_moments_out_of_balance() -> None:
    found = the(broken(lambda p: twist(p, 5, LF, 0, 0.02 * E)), "moment_balance", None, None, 5)
    assert found.amount == pytest.approx(0.04 * E.max(), abs=1e-5)  # the robot's weight by 1e-7 m of inverse kinematics


def test_moment_is_about_the_centre_of_mass_where_it_is() -> None:
    """The body moved sideways by 10 mm at one knot takes the centre of mass along, as far as pinocchio says, and M g
    turns about it by as much (and steps break).
    """

    def change(plan: plan_t) -> None:
        add(plan.knots[5], "body_position_w_m", 1, 0.01)

    report = broken(change)
    moved = copy.deepcopy(VALID.knots[5])
    add(moved, "body_position_w_m", 1, 0.01)
    way = synthetic.centre_of_mass(moved) - synthetic.centre_of_mass(VALID.knots[5])
    assert 0.004 < way[1] < 0.008  # the hands stay where they are
    expected = np.abs(np.cross(way, 9.6 * synthetic.gravity_w(45.0))).max()
    assert the(report, "moment_balance", None, None, 5).amount == pytest.approx(expected, abs=1e-5)
    assert [v.amount for v in only(report, "position_step")] == [pytest.approx(0.01)]


def test_velocity_that_does_not_carry_the_body() -> None:
    def change(plan: plan_t) -> None:
        add(plan.knots[5], "body_velocity_w_m_s", 1, 0.01)

    report = broken(change)
    assert the(report, "position_step", None, None, 5).amount == pytest.approx(0.01 * DT)
    assert only(report, "force_balance")[0].amount == pytest.approx(9.6 * 0.01 / DT)


def test_rate_that_does_not_turn_the_body() -> None:
    def change(plan: plan_t) -> None:
        add(plan.knots[5], "body_angular_velocity_b_rad_s", 2, 0.01)

    found = the(broken(change), "orientation_step", None, None, 5)
    assert found.amount == pytest.approx(0.01 * DT)


def test_angular_acceleration_needs_a_moment() -> None:
    """A yaw rate that jumps by 0.02 rad/s in one step without any moment: I w' with the robot's composite inertia."""

    def change(plan: plan_t) -> None:
        for knot in plan.knots[5:]:
            add(knot, "body_angular_velocity_b_rad_s", 2, 0.02)

    residual = only(broken(change), "moment_balance")
    assert residual[0].time_s == 4 * DT
    assert 0.2 < residual[0].amount / (0.02 / DT) < 1.5  # kg m^2: 6.8 kg of limbs some 0.3 m away, and the body


# ---- contacts


def test_finger_off_its_face() -> None:
    found = only(broken(lambda p: move(p, LF, slice(None), 0.002 * E)), "contact_face")
    assert [(v.limb, v.finger) for v in found] == [("LF", 1), ("LF", 2)]
    assert [v.amount for v in found] == pytest.approx([0.002, 0.002])


def test_patch_over_the_edge() -> None:
    """The patch of 20 mm on a face of 60 mm may be 10 mm off its middle."""
    found = only(broken(lambda p: move(p, LF, slice(None), 0.013 * T)), "contact_patch")
    assert [v.finger for v in found] == [1, 2]
    assert [v.amount for v in found] == pytest.approx([0.003, 0.003])


def test_pad_too_low() -> None:
    found = only(broken(lambda p: move(p, LF, slice(None), np.array([0.0, 0.0, -0.019]))), "pad_height")
    assert [v.finger for v in found] == [1, 2]
    assert [v.amount for v in found] == pytest.approx([0.004, 0.004])


def test_opening_axis_off_the_face_normal() -> None:
    def change(plan: plan_t) -> None:
        for knot in plan.knots:
            knot.limbs[RR].gripper_yaw_w_rad += 0.05

    found = the(broken(change), "finger_axis", RR, None, 0)
    assert found.amount == pytest.approx(0.05)


def test_stance_finger_moves() -> None:
    report = broken(lambda p: move(p, LF, slice(5, None), 0.004 * T))
    found = only(report, "contact_motion")
    assert [(v.limb, v.finger, v.time_s) for v in found] == [("LF", 1, 5 * DT), ("LF", 2, 5 * DT)]
    assert found[0].amount == pytest.approx(0.004 * abs(T).max())


def test_finger_moves_before_it_lets_go() -> None:
    report = broken(lambda p: move(p, RF, slice(3, 4), 0.004 * T))
    assert {(v.limb, v.time_s) for v in only(report, "contact_motion")} == {("RF", 3 * DT)}


def test_force_in_the_air() -> None:
    found = the(broken(lambda p: push(p, 4, RF, 2, np.array([0.3, 0.0, 0.4]))), "air_force", RF, 2, 4)
    assert found.amount == pytest.approx(0.5)


def test_moment_in_the_air() -> None:
    found = the(broken(lambda p: twist(p, 4, RF, 2, np.array([0.03, 0.0, 0.04]))), "air_moment", RF, 2, 4)
    assert found.amount == pytest.approx(0.05)


def test_two_limbs_on_one_hold() -> None:
    def change(plan: plan_t) -> None:
        for knot in plan.knots[7:]:
            knot.limbs[LF].hold = 4

    found = only(broken(change), "hold_shared")
    assert {(v.limb, v.time_s) for v in found} == {("RF", 7 * DT)}


def test_a_hold_is_taken_while_its_limb_still_stands_in_it() -> None:
    """LR arrives at b in the interval in which RF has unloaded but not yet let go of it."""

    def change(plan: plan_t) -> None:
        for knot in plan.knots[3:]:
            knot.limbs[LR].hold = 1

    assert (("LR", 3 * DT)) in {(v.limb, v.time_s) for v in only(broken(change), "hold_shared")}


@pytest.mark.parametrize(("hold", "face", "text"), [(5, 0, "not exist"), (-1, 0, "not exist"), (0, 4, "face 4")])
def test_hold_or_face_that_is_not_there(hold: int, face: int, text: str) -> None:
    def change(plan: plan_t) -> None:
        plan.knots[2].limbs[LF].hold, plan.knots[2].limbs[LF].finger1_face = hold, face

    assert text in the(broken(change), "hold", LF, None, 2).detail


def test_obstacle_taken_for_a_hold() -> None:
    def change(plan: plan_t) -> None:
        plan.holds[0].graspable = 0

    assert "obstacle" in only(broken(change), "hold")[0].detail


def test_hold_named_in_the_air() -> None:
    def change(plan: plan_t) -> None:
        plan.knots[4].limbs[RF].hold = 2

    the(broken(change), "hold", RF, None, 4)


def test_friction_copied_wrongly() -> None:
    def change(plan: plan_t) -> None:
        plan.knots[4].limbs[LR].friction = 2.5

    assert the(broken(change), "friction", LR, None, 4).amount == pytest.approx(0.3)


def test_swing_of_one_knot() -> None:
    def change(plan: plan_t) -> None:
        for knot in plan.knots[3:6]:
            limb = knot.limbs[RF]
            limb.phase, limb.hold, limb.finger1_face, limb.friction = 0, 1, 0, 2.2

    found = the(broken(change), "swing_structure", RF, None, 6)
    assert found.unit == "knots"


def test_plan_that_ends_in_the_air() -> None:
    def change(plan: plan_t) -> None:
        for knot in plan.knots[7:]:
            knot.limbs[RF].phase, knot.limbs[RF].hold, knot.limbs[RF].finger1_face = 1, -1, -1

    assert "ends" in the(broken(change), "swing_structure", RF, None, 3).detail
