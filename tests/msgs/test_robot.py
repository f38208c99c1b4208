from __future__ import annotations

import os
import shutil
import struct
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from crux_contracts.motors import (
    finger_current_A,
    flux_Wb,
    joint_continuous_torque_Nm,
    joint_current_A,
    of_both_fingers,
)
from crux_contracts.robot import ROBOTS, RobotError, load_robot, robot_hash, robot_names
from crux_contracts.robot_meaning import robot_meaning
from crux_contracts.urdf import parse_xml
from crux_contracts.yaml_document import parse_mapping

SCALER = ROBOTS / "scaler"
GOLDEN = ROBOTS.parent / "golden" / "robot_meaning"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of scaler to spoil."""
    shutil.copytree(SCALER, tmp_path / "robot")
    return tmp_path / "robot"


def spoil(folder: Path, file: str, right: str, wrong: str) -> None:
    path = folder / file
    text = path.read_text()
    assert right in text, "the case does not change the text"
    path.write_text(text.replace(right, wrong, 1))


def test_scaler_is_found_by_name_and_by_folder() -> None:
    assert "scaler" in robot_names()
    assert load_robot("scaler").hash == load_robot(SCALER).hash


def test_robots_of_ones_own_go_by_their_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for place in ("one/mine", "other/mine", "other/scaler"):
        shutil.copytree(SCALER, tmp_path / place)
    monkeypatch.setenv("CRUX_ROBOTS", os.pathsep.join(str(tmp_path / name) for name in ("one", "none", "other")))
    assert robot_names() == ["limbero", "mine", "scaler", "scaler-makers"]
    assert load_robot("mine").folder == tmp_path / "one" / "mine"
    assert load_robot("scaler").folder == tmp_path / "other" / "scaler"
    monkeypatch.delenv("CRUX_ROBOTS")
    assert load_robot("scaler").folder == SCALER
    with pytest.raises(RobotError, match="no such file"):
        load_robot("mine")


def test_the_meaning_is_the_golden_one() -> None:
    yaml = parse_mapping((GOLDEN / "robot.yaml").read_bytes(), "robot.yaml")
    urdf = parse_xml((GOLDEN / "made-up.urdf").read_bytes(), "made-up.urdf")
    assert robot_meaning(yaml, urdf) == (GOLDEN / "meaning.txt").read_text()


def test_keys_that_are_missing_have_their_defaults(folder: Path) -> None:
    spoil(folder, "robot.yaml", "  rate_N_s: 200\n", "  rate_N_s: 45\n")
    spoil(folder, "robot.yaml", "  stand_s: 0.2\n", "")
    test = load_robot(folder).grasp_test
    assert (test.rate_N_s, test.stand_s) == (45.0, 0.3)
    text = (folder / "robot.yaml").read_text()
    start = text.index("grasp_test:")
    (folder / "robot.yaml").write_text(text[:start] + text[text.index("localisation:") :])
    assert load_robot(folder).grasp_test.rate_N_s == 30.0


def test_the_hash_is_of_what_the_files_say_not_of_how(folder: Path) -> None:
    before = robot_hash(folder)
    spoil(folder, "robot.yaml", "  rate_Hz: 500\n", "\n    # cycles a second\n  rate_Hz: 5.0e+2\n")
    spoil(folder, "scaler.urdf", '<mass value="2.8"/>', "<!-- weighed -->\n\n<mass   value='+2.800'></mass>")
    assert robot_hash(folder) == before
    spoil(folder, "scaler.urdf", "+2.800", "2.8000000000000003")
    assert robot_hash(folder) != before


@pytest.mark.parametrize("number", [-1.0, 0.1 + 0.2, 1e308, 5e-324, 123456789012345678.0])
def test_a_number_is_the_same_in_any_form(number: float) -> None:
    forms = {repr(number), f"{number:.17e}", f"{number:+.20E}"}
    meanings = {robot_meaning(parse_mapping(f"x: {form}".encode(), ""), ET.Element("robot")) for form in forms}
    assert len(forms) == 3
    assert len(meanings) == 1
    assert struct.pack(">d", number).hex() in meanings.pop()


def test_masses_and_geometry_agree_with_pinocchio() -> None:
    robot = load_robot("scaler")
    model = pinocchio.buildModelFromUrdf(str(robot.urdf_path), pinocchio.JointModelFreeFlyer())
    assert robot.total_mass_kg == pytest.approx(pinocchio.computeTotalMass(model))
    data = model.createData()
    q = pinocchio.neutral(model)
    q[2] = 0.0
    # Arms straight, wrist straight: the gripper hangs under the stretched limb.
    pinocchio.framesForwardKinematics(model, data, q)
    for limb in robot.limbs:
        frame = data.oMf[model.getFrameId(limb.gripper_link)]
        reach = limb.upper_link_m + limb.lower_link_m
        outward = np.array([np.cos(limb.mount_rad), np.sin(limb.mount_rad), 0.0])
        expected = limb.shoulder_b_m + reach * outward - np.array([0, 0, limb.wrist_to_gripper_m])
        assert frame.translation == pytest.approx(expected, abs=1e-9)
        yaw = limb.mount_rad + limb.gripper_mount_rad
        assert frame.rotation == pytest.approx(pinocchio.utils.rotate("z", yaw), abs=1e-9)
        for index, name in enumerate(limb.joint_names):
            joint = model.joints[model.getJointId(name)]
            assert limb.lower_rad[index] == model.lowerPositionLimit[joint.idx_q]
            assert limb.upper_rad[index] == model.upperPositionLimit[joint.idx_q]
            assert limb.effort_Nm[index] == model.effortLimit[joint.idx_v]
            assert limb.joints[index].velocity == model.velocityLimit[joint.idx_v]


def test_the_hand_is_what_hangs_behind_the_sensor() -> None:
    robot = load_robot("scaler")
    for limb in robot.limbs:
        # Gripper 0.25 kg at z = 0.06, two fingers 0.05 kg at z = 0.02, symmetric about the gripper's z.
        assert limb.hand_mass_kg == pytest.approx(0.35)
        assert limb.hand_com_g_m == pytest.approx([0, 0, (0.25 * 0.06 + 0.1 * 0.02) / 0.35])


def test_sections_are_typed() -> None:
    robot = load_robot("scaler")
    assert robot.dt_s == pytest.approx(0.002)
    assert robot.can.nodes["gripper"] == 7
    assert len(robot.servo.position_gain_Nm_rad) == 6
    low, high = robot.gripper.opening_m
    assert low < robot.gripper.open_opening_m < high
    assert [limb.name for limb in robot.limbs] == ["LF", "RF", "LR", "RR"]
    assert [limb.bus for limb in robot.limbs] == [0, 1, 2, 3]


def test_the_motors_bear_what_climbs_ask_of_the_joints() -> None:
    robot = load_robot("scaler")
    motor = robot.motor
    assert joint_continuous_torque_Nm(motor) > 5.2  # rms of the hardest joint in a climb
    # Power at the rotor less the gear's loss is power at the joint.
    current_A, speed_rad_s = joint_current_A(motor, 3.0), 2.0
    rotor_W = 1.5 * motor.pole_pairs * flux_Wb(motor) * current_A * speed_rad_s * motor.gear_ratio
    assert rotor_W * motor.gear_efficiency == pytest.approx(3.0 * speed_rad_s)
    screw = robot.gripper_motor
    turns_a_s = 0.01 / screw.screw_lead_m
    rotor_W = screw.torque_constant_Nm_A * finger_current_A(screw, 40.0) * 2 * np.pi * turns_a_s
    assert rotor_W * screw.screw_efficiency == pytest.approx(2 * 40.0 * 0.01)
    # One energy, seen at the fingers and at the rotor.
    assert 0.5 * of_both_fingers(screw, 2.0) * (2 * np.pi * turns_a_s) ** 2 == pytest.approx(2 * 0.5 * 2.0 * 0.01**2)


def test_the_admittance_has_fifteen_degrees_of_phase_left_against_twice_its_stiffest_environment() -> None:
    a = load_robot("scaler").admittance
    s = 1j * np.geomspace(0.1, 1e4, 200_000)
    for mass, damping, spring, environment in (
        (a.mass_kg, a.damping_Ns_m, a.stiffness_N_m, a.environment_N_m),
        (a.inertia_kg_m2, a.rotational_damping_Nms_rad, a.rotational_stiffness_Nm_rad, a.environment_Nm_rad),
    ):
        loop = 2 * environment * np.exp(-s * a.delay_s) / (mass * s**2 + damping * s + spring)
        crossing = np.flatnonzero((np.abs(loop[:-1]) >= 1) & (np.abs(loop[1:]) < 1))
        assert len(crossing) == 1
        assert 180 + np.degrees(np.unwrap(np.angle(loop))[crossing[0]]) >= 15


def test_a_folder_without_a_robot_is_told(tmp_path: Path) -> None:
    with pytest.raises(RobotError, match=r"robot\.yaml: no such file"):
        load_robot(tmp_path)


def test_everything_that_is_wrong_is_told_at_once(folder: Path) -> None:
    spoil(folder, "scaler.urdf", '<box size="0.30 0.22 0.06"/>', '<mesh filename="body.stl"/>')
    spoil(
        folder, "scaler.urdf", '<joint name="LF_joint3" type="revolute">', '<joint name="LF_joint3" type="continuous">'
    )
    spoil(folder, "scaler.urdf", 'lower="0.008" upper="0.066" effort="60"', 'lower="0.008" upper="0.066" effort="0"')
    spoil(folder, "scaler.urdf", '<origin xyz="-0.1355 0.144 0"', '<origin xyz="0.1 0.144 0"')
    spoil(folder, "robot.yaml", "coarse_travel_m: 0.065", "coarse_travel_m: 0.05")
    with pytest.raises(RobotError) as raised:
        load_robot(folder)
    told = [(Path(problem.file or raised.value.path).name, problem.key) for problem in raised.value.problems]
    assert told == [
        ("scaler.urdf", "link base"),
        ("scaler.urdf", "joint LF_finger1_slide"),
        ("scaler.urdf", "joint LF_joint3"),
        ("scaler.urdf", "joint LR_joint1"),
        ("robot.yaml", "gripper_motor.coarse_travel_m"),
    ]
