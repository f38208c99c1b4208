"""`crux robot import`: the shipped robot, told in another way, comes back; what nobody says is listed at once."""

from __future__ import annotations

import itertools
import json
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from crux_contracts.robot import ROBOTS, Robot, load_robot
from crux_contracts.urdf import rotation
from crux_planner.checker.limb_model import load_model
from crux_planner.checker.parts import shapes
from crux_planner.model.chain import forward
from crux_planner.model.shapes import limb_radii_m
from crux_tools import cli
from crux_tools.paths import ROOT
from other_counts import with_joints

LIMBS = {"LF": "", "RF": "1", "LR": "3", "RR": "2"}
KINDS = ("yaw", "hip", "knee", "pitch", "roll", "turn")
MAPPING = """
name: mine
like: scaler
body_link: trunk
limbs: {LF: "", RF: 1, LR: 3, RR: 2}
joints: ["yaw{}", "hip{}", "knee{}", "pitch{}", "roll{}", "turn{}"]
gripper: {link: "palm{}", origin_m: [0, 0, -0.03], rpy_rad: [0, 0, 0]}
fingers: ["left{}", "right{}"]
locked: {"tail": 0.3}
limits_rad: {turn: [-2.9, 2.9]}
effort_Nm: {default: 12, pitch: 6, roll: 6, turn: 6}
speed_rad_s: {default: 4.8}
finger: {effort_N: 60, speed_m_s: 0.02}
"""


def text(values: object) -> str:
    return " ".join(f"{float(v):.15g}" for v in np.asarray(values))


def rpy(turn: np.ndarray) -> np.ndarray:
    return np.asarray(pinocchio.rpy.matrixToRpy(turn))


def in_other_words(root: ET.Element) -> None:
    """The shipped URDF with a maker's conventions: every joint about the z of its own frame, some of them backwards,
    other names, a continuous last joint, no efforts, gripper and fingers measured from elsewhere."""
    turns = {"base": np.eye(3)}
    names = {"base": "trunk"}
    for joint in root.findall("joint"):
        name = joint.attrib["name"]
        limb, kind = name.split("_", 1)
        parent, child, origin = (joint.find(tag) for tag in ("parent", "child", "origin"))
        assert parent is not None
        assert child is not None
        assert origin is not None
        own = np.eye(3)
        axis = joint.find("axis")
        if axis is not None and joint.get("type") == "revolute":
            z = np.array([float(v) for v in axis.attrib["xyz"].split()])
            index = int(kind[-1]) - 1
            if index in (1, 5):
                z = -z
                limit = joint.find("limit")
                assert limit is not None
                low, high = limit.attrib["lower"], limit.attrib["upper"]
                limit.set("lower", str(-float(high)))
                limit.set("upper", str(-float(low)))
            x = np.roll(z, 1)
            own = np.column_stack([x, np.cross(z, x), z])
            axis.set("xyz", "0 0 1")
            joint.set("name", KINDS[index] + LIMBS[limb])
            if index == 5:
                joint.set("type", "continuous")
        before = turns[parent.attrib["link"]]
        xyz = np.array([float(v) for v in origin.attrib["xyz"].split()])
        turn = rotation(tuple(float(v) for v in origin.get("rpy", "0 0 0").split()))  # type: ignore[arg-type]
        if kind == "mount":
            xyz[2] += 0.03
        if joint.get("type") == "prismatic":
            xyz[2] -= 0.03
            joint.set("name", ("left" if kind.startswith("finger1") else "right") + LIMBS[limb])
            limit = joint.find("limit")
            assert limit is not None
            limit.set("effort", "0")
        origin.set("xyz", text(before.T @ xyz))
        origin.set("rpy", text(rpy(before.T @ turn @ own)))
        turns[child.attrib["link"]] = own
        names[child.attrib["link"]] = f"palm{LIMBS[limb]}" if kind == "mount" else child.attrib["link"] + "_x"
    for link in root.findall("link"):
        turn, shift = turns[link.attrib["name"]].T, np.zeros(3)
        if link.attrib["name"].endswith("gripper"):
            shift = np.array([0.0, 0.0, -0.03])
        for origin in link.iter("origin"):
            xyz = np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])
            own = rotation(tuple(float(v) for v in origin.get("rpy", "0 0 0").split()))  # type: ignore[arg-type]
            origin.set("xyz", text(turn @ (xyz + shift)))
            origin.set("rpy", text(rpy(turn @ own)))
    for element in root.iter():
        for key in ("link", "name"):
            if element.tag in ("link", "parent", "child") and key in element.attrib:
                element.set(key, names[element.attrib[key]])


def maker(folder: Path) -> Path:
    tree = ET.parse(ROBOTS / "scaler" / "scaler.urdf")
    root = tree.getroot()
    in_other_words(root)
    mass = root.find("link[@name='trunk']/inertial/mass")
    assert mass is not None
    mass.set("value", "2.6")
    inertia = '<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/>'
    root.append(ET.fromstring(f'<link name="vane"><inertial><mass value="0.2"/>{inertia}</inertial></link>'))
    root.append(
        ET.fromstring(
            '<joint name="tail" type="continuous"><parent link="trunk"/><child link="vane"/><axis xyz="0 1 0"/></joint>'
        )
    )
    path = folder / "maker.urdf"
    tree.write(path)
    return path


def test_the_shipped_robot_in_other_words_comes_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    words = ["robot", "import", str(maker(tmp_path)), "--mapping", str(tmp_path / "mapping.yaml")]
    assert cli.main([*words, "-o", str(tmp_path / "mine"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["taken"], said["problems"]) == (True, [])
    one, other = load_robot("scaler"), load_robot(tmp_path / "mine")
    for a, b in zip(one.limbs, other.limbs, strict=True):
        assert list(b.senses) == [1, -1, 1, 1, 1, -1]
        for key in ("lower_rad", "upper_rad", "effort_Nm", "shoulder_b_m", "hand_com_g_m"):
            assert getattr(b, key) == pytest.approx(getattr(a, key), abs=1e-8), key
        for key in ("mount_rad", "upper_link_m", "lower_link_m", "wrist_to_gripper_m", "gripper_mount_rad"):
            assert getattr(b, key) == pytest.approx(getattr(a, key), abs=1e-8), key
        for own, others in zip(a.joints, b.joints, strict=True):
            assert others.velocity == pytest.approx(own.velocity, abs=1e-8)
            assert one.urdf.links[own.child].com_m == pytest.approx(other.urdf.links[others.child].com_m, abs=1e-7)
            inertia = other.urdf.links[others.child].inertia_kg_m2
            assert one.urdf.links[own.child].inertia_kg_m2 == pytest.approx(inertia, abs=1e-9)
    assert other.urdf.links["base"].mass_kg == pytest.approx(2.8)  # with the tail
    assert other.total_mass_kg == pytest.approx(one.total_mass_kg)
    model = pinocchio.buildModelFromUrdf(str(other.urdf_path))  # it is a URDF to others, too
    assert pinocchio.computeTotalMass(model) == pytest.approx(one.total_mass_kg - 2.8)


def test_gears_and_belts_come_in_by_the_mapping(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    belt = "transmissions.coupled_to: [0, 0, 2, 0, 0, 0], transmissions.coupling: [0, 0, -1, 0, 0, 0]"
    gears = "transmissions.ratio: [-1, 1.2, 1, 1, 1, 1], transmissions.torque_Nm: [10, 12, 12, 6, 6, 6]"
    damping = "servo.velocity_gain_Nms_rad: [1.2, 1.2, 1.2, 0.5, 0.5, 0.5]"
    (tmp_path / "mapping.yaml").write_text(f"{MAPPING}set: {{{gears}, {belt}, {damping}}}\n")
    words = ["robot", "import", str(maker(tmp_path)), "--mapping", str(tmp_path / "mapping.yaml")]
    assert cli.main([*words, "-o", str(tmp_path / "mine"), "--json"]) == 0
    for limb in load_robot(tmp_path / "mine").limbs:
        q = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
        assert limb.transmission.actuators_rad(q) == pytest.approx([-0.1, 0.24, 0.1, 0.4, 0.5, 0.6])
        assert limb.effort_Nm[0] == 10.0
    capsys.readouterr()
    assert cli.main(["robot", "check", str(tmp_path / "mine"), "--json"]) == 0
    checks = {check["topic"]: check["found"] for check in json.loads(capsys.readouterr().out)["checks"]}
    assert "actuators -12.6..12.6" in checks["limits"]
    assert "(actuator)" in checks["peak torques"]


def test_everything_that_is_missing_is_listed_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gone = ("locked", "limits_rad", "effort", "speed", "finger:", "like")
    lines = [line for line in MAPPING.splitlines() if not line.startswith(gone)]
    (tmp_path / "mapping.yaml").write_text("\n".join([*lines, "colour: red"]))
    urdf = maker(tmp_path)
    urdf.write_text(urdf.read_text().replace('effort="12"', 'effort="0"'))
    words = ["robot", "import", str(urdf), "--mapping", str(tmp_path / "mapping.yaml")]
    assert cli.main([*words, "-o", str(tmp_path / "mine"), "--json"]) == 2
    errors = json.loads(capsys.readouterr().out)["error"].splitlines()
    told = [line.removeprefix(f"{tmp_path / 'mapping.yaml'}: ") for line in errors]
    for start in (
        "colour: unknown key",
        "like: is missing",
        "locked.tail: continuous: is missing",
        "limits_rad: turn: is missing",
        "effort_Nm: yaw, hip, knee, turn: is missing",
        "speed_rad_s: turn: is missing",
        "finger.effort_N: is missing",
    ):
        assert sum(line.startswith(start) for line in told) == 1, (start, told)
    assert len(told) == 7
    assert not (tmp_path / "mine").exists()


def test_without_a_mapping_it_says_what_one_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["robot", "import", str(maker(tmp_path)), "-o", str(tmp_path / "mine")]) == 2
    errors = capsys.readouterr().err
    for key in ("name", "like", "body_link", "limbs", "joints", "gripper", "fingers"):
        assert f"MAPPING: {key}: is missing" in errors


def test_a_folder_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "robot.yaml").write_text("mine")
    words = ["robot", "import", str(maker(tmp_path)), "--mapping", str(tmp_path / "mapping.yaml")]
    assert cli.main([*words, "-o", str(tmp_path / "mine")]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "mine" / "robot.yaml").read_text() == "mine"


def test_meshes_become_capsules_and_masses_are_scaled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = maker(tmp_path)
    urdf.write_text(re.sub(r"<cylinder [^>]*/>", '<mesh filename="a.stl"/>', urdf.read_text()))
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(MAPPING + "masses_kg: {total: 12, body: 3}\n")
    words = ["robot", "import", str(urdf), "--mapping", str(mapping), "-o", str(tmp_path / "mine")]
    assert cli.main(words) == 2
    assert "capsule_radius_m: is missing" in capsys.readouterr().err
    mapping.write_text(mapping.read_text() + "capsule_radius_m: 0.02\n")
    assert cli.main(words) == 0
    assert "[A] masses" in capsys.readouterr().err
    path = tmp_path / "mine" / "mine.urdf"
    links = {link.get("name"): link for link in ET.parse(path).getroot().findall("link")}
    assert masses(path) == pytest.approx({name: mass * 9 / 6.8 for name, mass in masses(SHIPPED).items()} | {"base": 3})
    shapes = links["LF_link2"].findall("visual")
    assert [shape.find("geometry/capsule") is not None for shape in shapes] == [True]
    capsule, origin = shapes[0].find("geometry/capsule"), shapes[0].find("origin")
    assert capsule is not None
    assert origin is not None
    assert capsule.attrib == {"radius": "0.02", "length": "0.15000"}
    assert origin.attrib["xyz"] == "0.075 0 0"


def test_speeds_of_no_motor_are_the_mappings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, mapping = maker(tmp_path), tmp_path / "mapping.yaml"
    text = urdf.read_text().replace('velocity="4.8"', 'velocity="1000"')
    urdf.write_text(text.replace("<link", "<!-- <xacro:limb/> --><link", 1))
    mapping.write_text(MAPPING)
    words = ["robot", "import", str(urdf), "--mapping", str(mapping), "-o", str(tmp_path / "mine"), "--json"]
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out)["problems"] == []


def test_meshes_do_not_hinder_an_import(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = maker(tmp_path)
    text = re.sub(r"<cylinder [^>]*/>", '<mesh filename="a.stl"/>', urdf.read_text())
    urdf.write_text(text.replace('<axis xyz="0 0 1"', '<axis xyz="0 one"', 1))
    assert cli.main(["robot", "import", str(urdf), "-o", str(tmp_path / "mine")]) == 2
    said = capsys.readouterr().err
    assert 'joint yaw: xyz="0 one": expected 3 finite numbers' in said
    assert "<mesh>" not in said


FIVE = """
name: mine
like: scaler
body_link: base
limbs: {LF: LF, RF: RF, LR: LR, RR: RR}
joints: ["{}_joint1", "{}_joint2", "{}_joint3", "{}_joint4", "{}_joint6"]
gripper: {link: "{}_gripper"}
fingers: ["{}_finger1_slide", "{}_finger2_slide"]
"""


def test_limbs_of_five_joints_come_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, mapping = with_joints(5, tmp_path) / "scaler.urdf", tmp_path / "mapping.yaml"
    mapping.write_text(FIVE)
    words = ["robot", "import", str(urdf), "--mapping", str(mapping), "-o", str(tmp_path / "mine"), "--json"]
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out)["problems"] == []
    one, other = load_robot(tmp_path / "scaler"), load_robot(tmp_path / "mine")
    assert other.can.nodes == {"joint1": 1, "joint2": 2, "joint3": 3, "joint4": 4, "joint6": 5, "gripper": 7}
    q_rad = np.array([[0.3, 0.4, 1.5, -0.6, 0.2, 0.0]])
    for a, b in zip(one.limbs, other.limbs, strict=True):
        assert forward(b.at_zero, q_rad).gripper_m == pytest.approx(forward(a.at_zero, q_rad).gripper_m, abs=2e-5)


def test_what_a_mapping_names_and_the_urdf_has_not_is_told_of_all_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf, mapping = with_joints(5, tmp_path) / "scaler.urdf", tmp_path / "mapping.yaml"
    mapping.write_text(FIVE.replace("{}_joint3", "{}_knee").replace("{}_finger1_slide", "{}_joint1"))
    assert cli.main(["robot", "import", str(urdf), "--mapping", str(mapping), "-o", str(tmp_path / "mine")]) == 2
    said = capsys.readouterr().err
    for limb in LIMBS:
        assert f"joints: {limb}_knee: expected of limb {limb} one of the URDF's revolute or continuous joints" in said
        assert f"fingers: {limb}_joint1: revolute: expected of limb {limb} one of the URDF's prismatic joints" in said
    urdf.write_text(re.sub('type="prismatic"', 'type="fixed"', urdf.read_text()))
    assert cli.main(["robot", "import", str(urdf), "-o", str(tmp_path / "mine")]) == 2
    said = capsys.readouterr().err
    assert "LF_joint1 (revolute)" in said
    assert "none slides: crux grips with two fingers that do" in said


SHIPPED = ROBOTS / "scaler" / "scaler.urdf"


def masses(path: Path) -> dict[str, float]:
    """Of a URDF's links that have one; by name, which are those of the shipped robot here."""
    found = {}
    for link in ET.parse(path).getroot().findall("link"):
        mass = link.find("inertial/mass")
        if mass is not None:
            found[link.attrib["name"]] = float(mass.attrib["value"])
    return found


MAKERS = ROOT / "examples" / "makers-scaler"


def test_the_scaler_of_its_makers_comes_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf, mapping = MAKERS / "scaler.urdf", MAKERS / "mapping.yaml"
    words = ["robot", "import", str(urdf), "--mapping", str(mapping), "-o", str(tmp_path / "robot"), "--json"]
    assert cli.main(words) == 0
    assert json.loads(capsys.readouterr().out)["problems"] == []
    robot = load_robot(tmp_path / "robot")
    model = pinocchio.buildModelFromUrdf(str(urdf))
    random, data = np.random.default_rng(0), model.createData()
    for name, n in {"LF": 0, "RF": 1, "LR": 3, "RR": 2}.items():
        limb = next(each for each in robot.limbs if each.name == name)
        q_rad = random.uniform(limb.lower_rad, limb.upper_rad)
        q = pinocchio.neutral(model)
        for joint, angle in zip(limb.joint_names, q_rad, strict=True):
            place = model.joints[model.getJointId(joint.removeprefix(f"{name}_") + str(n))].idx_q
            q[place : place + 2] = np.cos(angle), np.sin(angle)
        pinocchio.framesForwardKinematics(model, data, q)
        hand = data.oMf[model.getFrameId(f"fk_gripper{n}_link")]
        here = forward(limb.at_zero, q_rad[None])
        assert here.gripper_m[:, 0] == pytest.approx(hand.translation, abs=5e-5)
        assert here.rotation[..., 0] == pytest.approx(hand.rotation, abs=2e-4)
    assert cli.main(["robot", "check", str(tmp_path / "robot"), "--json"]) == 0
    checks = {check["topic"]: check for check in json.loads(capsys.readouterr().out)["checks"]}
    assert checks["self-collision"]["verdict"] == "good"
    assert limb_radii_m(robot) == pytest.approx((0.0, 0.02, 0.02, 0.02))
    assert not meets_hold(robot)


def test_the_five_bar_of_the_makers_comes_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where crux has the actuators, the makers' crank and forearm are as far apart as the rod is long."""
    urdf, mapping = MAKERS / "scaler.urdf", MAKERS / "mapping.yaml"
    words = ["robot", "import", str(urdf), "--mapping", str(mapping), "-o", str(tmp_path / "robot")]
    assert cli.main(words) == 0
    assert "[A] crank and rod" in capsys.readouterr().err
    robot = load_robot(tmp_path / "robot")
    model = pinocchio.buildModelFromUrdf(str(urdf))
    random, data = np.random.default_rng(1), model.createData()
    for name, n in {"LF": 0, "RF": 1, "LR": 3, "RR": 2}.items():
        limb = next(each for each in robot.limbs if each.name == name)
        for q_rad in random.uniform(limb.lower_rad, limb.upper_rad, (5, 6)):
            turned = limb.transmission.actuators_rad(q_rad)
            assert turned == pytest.approx([*q_rad[:2], turned[2], *q_rad[3:]])
            q = pinocchio.neutral(model)
            for joint, angle in {"F": q_rad[1], "E": q_rad[2], "A": turned[2]}.items():
                place = model.joints[model.getJointId(f"{joint}_Joint{n}")].idx_q
                q[place : place + 2] = np.cos(angle), np.sin(angle)
            pinocchio.framesForwardKinematics(model, data, q)
            ends = [data.oMf[model.getFrameId(link)].translation for link in (f"B_Link{n}", f"C_Link{n}1")]
            assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(0.142, abs=5e-5)


@pytest.mark.parametrize(
    ("was", "wrong", "said"),
    [
        ("A_Joint{}", "A_Joint", "five_bar.crank: A_Joint: expected a name with {} for the limb"),
        ('first: "F_Joint', 'first: "G_Joint', "five_bar.first: G_Joint{}: expected one of joints with another behind"),
        ('first: "F_Joint', 'first: "Shoulder_Joint', "about parallel axes"),
        ("C_Link{}1", "C_Link{}5", "five_bar.pin: C_Link05: expected a link of the next joint on limb LF"),
        ("B_Joint{}", "G_Joint{}", "five_bar.rod: G_Joint0: expected a joint before the first joint on limb LF"),
        ("A_Joint: [-1.4, 2.2], ", "", "limits_rad: A_Joint: is missing"),
    ],
)
def test_what_is_no_five_bar_is_told(
    was: str, wrong: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, mapping = (MAKERS / "mapping.yaml").read_text(encoding="utf-8"), tmp_path / "mapping.yaml"
    assert was in text
    mapping.write_text(text.replace(was, wrong))
    words = ["robot", "import", str(MAKERS / "scaler.urdf"), "--mapping", str(mapping), "-o", str(tmp_path / "robot")]
    assert cli.main(words) == 2
    assert said in capsys.readouterr().err


def meets_hold(robot: Robot) -> bool:
    """Whether a hold as wide and high as its pads can have it touches more of a hand than its pads."""
    model = load_model(robot)
    limb, half = model.limbs[0], np.array([0.03, 0.03, 0.03])
    state = limb.forward(np.zeros((1, 6)), np.array([half[0]]))
    place, turn = state.link_position_m[limb.gripper][0], state.link_rotation[limb.gripper][0]
    hand = [link for link in limb.links if link.name.endswith(("gripper", "finger1", "finger2", "link6"))]
    assert sum(len(link.capsules) + len(link.boxes) for link in hand) == 4
    for link in hand:
        for part in shapes("link", link, state.link_position_m[link.name], state.link_rotation[link.name]):
            points = np.linspace(part.start[0], part.end[0], 20)
            if part.half_m is not None and part.rotation is not None:
                corners = np.array(list(itertools.product((-1, 1), repeat=3))) * part.half_m
                points = part.start[0] + corners @ part.rotation[0].T
            away = np.abs((points - place) @ turn) - half
            if (np.maximum(away, 0.0) ** 2).sum(axis=1).min() < (part.radius_m - 1e-9) ** 2:
                return True
    return False
