"""Robot descriptions that are wrong, each in one way, and what the message about it must name: edits of scaler's files.

The shipped robot with every edit of ALRIGHT is another robot that both readers must take.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from crux_contracts.robot import ROBOTS

YAML, URDF = "robot.yaml", "scaler.urdf"
_TORQUES, _SPEEDS = "  torque_Nm: [12, 24, 24, 6, 6, 6]\n", "  speed_rad_s: [4.8, 4.8, 4.8, 4.8, 4.8, 4.8]\n"
_LIMITS = _TORQUES + _SPEEDS
_ABOUT_CRANK, _CRANK_STANDS = "  coupled_to: [0, 0, 0, 3, 0, 0]\n", "  low_rad: [-3, -3, 3, -3, -3, -3]\n"


@dataclass(frozen=True)
class Case:
    """`change` makes the text of a file another; the message must have every one of `names` in it."""

    id: str
    file: str
    change: Callable[[str], str]
    names: tuple[str, ...]

    def write(self, folder: Path) -> Path:
        """The robot's folder, in `folder`."""
        robot = folder / "scaler"
        shutil.copytree(ROBOTS / "scaler", robot)
        path = robot / self.file
        before = path.read_text(encoding="utf-8")
        after = self.change(before)
        assert after != before, f"{self.id}: the change did nothing, the description has moved on"
        path.write_text(after, encoding="utf-8")
        return robot


def _yaml(id_: str, old: str, new: str, *names: str) -> Case:
    """The first `old` of robot.yaml becomes `new`."""
    return Case(id_, YAML, lambda text: text.replace(old, new, 1), names)


def _urdf(id_: str, old: str, new: str, *names: str) -> Case:
    return Case(id_, URDF, lambda text: text.replace(old, new, 1), names)


def _all(id_: str, old: str, new: str, *names: str) -> Case:
    """Every `old` of the URDF."""
    return Case(id_, URDF, lambda text: text.replace(old, new), names)


def _in(element: str, id_: str, old: str, new: str, *names: str) -> Case:
    """The first `old` behind a <joint name="..." or a <link name="..."."""
    kind, name = element.split()

    def change(text: str) -> str:
        start = text.index(f'<{kind} name="{name}"')
        return text[:start] + text[start:].replace(old, new, 1)

    return Case(id_, URDF, change, names)


def _in_millimetres(text: str) -> str:
    def scaled(match: re.Match[str]) -> str:
        return f'{match[1]}="{" ".join(f"{1000 * float(word):g}" for word in match[2].split())}"'

    return re.sub(r'\b(xyz|size|radius|length)="([^"]+)"(?!/>\n    <limit)', scaled, text)


def _before_end(text: str, more: str) -> str:
    return text.replace("</robot>", f"{more}\n</robot>")


def _transmissions(id_: str, line: str, *names: str) -> Case:
    """With a section that has this line."""
    return Case(id_, YAML, lambda text: f"{text}transmissions:\n  {line}\n", names)


def _five_bar(id_: str, change: dict[str, float], *names: str, limits: str = _LIMITS) -> Case:
    """With one that is right but for this."""
    keys = {"first_joint": 2, "crank_y_m": 0.038, "crank_m": 0.15, "rod_m": 0.188, "pin_x_m": 0.177, "pin_y_m": -0.046,
            "bends": -1} | change  # fmt: skip
    lines = "".join(f"  {key}: {value}\n" for key, value in keys.items())
    return Case(id_, YAML, lambda text: f"{text}five_bar:\n{lines}transmissions:\n{limits}", names)


def _added(id_: str, more: str, *names: str) -> Case:
    return Case(id_, URDF, lambda text: _before_end(text, more), names)


def _fixed(name: str, parent: str, child: str) -> str:
    return f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'


def _against(text: str) -> str:
    """The same robot with all second joints turning against the axis, so that their limits change sides."""
    before = '<axis xyz="0 -1 0"/>\n    <limit lower="-1.2" upper="2.0"'
    return text.replace(before, '<axis xyz="0 1 0"/>\n    <limit lower="-2.0" upper="1.2"')


def _turned_in_between(text: str) -> str:
    """That, without the turn back."""
    return _in_between(text).replace("0 -1.5707963267948966 0", "0 0 0")


def _in_between(text: str) -> str:
    """The same robot with LF's upper link in two, the outer one turned, and back again by the elbow's joint."""
    extra = '<link name="extra"/>' + _fixed("seam", "LF_link2", "extra").replace("/></", "/>" + SEAM + "</", 1)
    start = text.index('<joint name="LF_joint3"')
    joint = (
        text[start:]
        .replace("LF_link2", "extra", 1)
        .replace(ARM, '<origin xyz="0 0 0.07" rpy="0 -1.5707963267948966 0"/>', 1)
    )
    return _before_end(text[:start] + joint, extra)


SEAM = '<origin xyz="0.08 0 0" rpy="0 1.5707963267948966 0"/>'
INERTIAL = (
    '<inertial><mass value="{}"/><inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>'
)
HELD = '<inertia ixx="0.0004" ixy="0" ixz="0" iyy="0.0003" iyz="0" izz="0.0004"/>'
SPREAD = '<inertia ixx="0.25" ixy="5e-17" ixz="0" iyy="0.25" iyz="0" izz="0.25"/>'  # of 0.25 kg: 1 m about each axis
ARM = '<origin xyz="0.15 0 0" rpy="0 0 0"/>'
FINGER = 'type="prismatic"'
AXIS = '<axis xyz="1 0 0"/>'


def _coupled(text: str) -> str:
    return f"{text}transmissions:\n  coupled_to: [0, 0, 2, 0, 0, 0]\n  coupling: [0, 0, -0.5, 0, 0, 0]\n"


def _untested(text: str) -> str:
    """Without the section of the pull on new grasps."""
    return re.sub(r"^grasp_test:.*\n(  .*\n)+", "", text, flags=re.MULTILINE)


OF_THE_FILES = [
    _yaml("no yaml", "version: 1", "version: [1", "robot.yaml", "is not YAML"),
    _yaml("version", "version: 1", "version: 2", "version: 2", "in 1..1"),
    _yaml("anchor", "name: scaler", "name: &x scaler", "anchors and aliases"),
    _yaml("tag", "name: scaler", "name: !!str scaler", "tags (!)"),
    Case("two documents", YAML, lambda text: text + "\n---\nversion: 1\n", ("one document only",)),
    Case("empty yaml", YAML, lambda _: "# nothing\n", ("is empty",)),
    Case("a list", YAML, lambda _: "- 1\n", ("a list of 1", "expected a mapping")),
    _yaml("key twice", "  rate_Hz: 500", "  rate_Hz: 500\n  rate_Hz: 500", "can.rate_Hz", "twice"),
    _yaml("urdf elsewhere", "urdf: scaler.urdf", "urdf: ../scaler.urdf", "urdf", "expected a file name"),
    _yaml("no urdf", "urdf: scaler.urdf", "urdf: other.urdf", "other.urdf", "no such file"),
    _yaml("unknown body", "body_link: base", "body_link: torso", "link torso", "no such link", "body_link"),
    _urdf("no xml", "<robot ", "<robot<", "scaler.urdf", "is not XML"),
    _urdf("doctype", '<?xml version="1.0"?>', '<!DOCTYPE r [<!ENTITY a "b">]>', "document types and entities"),
    Case("another root", URDF, lambda t: t.replace("robot", "automaton"), ("<automaton>", "expected a <robot>")),
    _urdf("nameless robot", '<robot name="scaler">', "<robot>", "robot", "needs the attribute name"),
]
OF_ROBOT_YAML = [
    _transmissions("a coupling to itself", "coupled_to: [0, 0, 3, 0, 0, 0]", "transmissions.coupled_to[2]", "3"),
    _transmissions("a coupling to half a joint", "coupled_to: [0, 0, 1.5, 0, 0, 0]", "coupled_to[2]", "1.5"),
    _transmissions("a joint that nothing moves", "ratio: [1, 1, 1, 0, 1, 1]", "transmissions.ratio", "every joint"),
    _transmissions(
        "no way for a joint", "low_rad: [3, -3, -3, -3, -3, -3]", "transmissions.low_rad", "joint 1 of limb"
    ),
    _transmissions("a ratio too few", "ratio: [1, 1, 1, 1, 1]", "transmissions.ratio", "a list of 6 numbers"),
    _transmissions("a torque of nothing", "torque_Nm: [1, 1, 1, 1, 1, 0]", "transmissions.torque_Nm[5]", "0"),
    _five_bar("a five-bar of crossed axes", {"first_joint": 1}, "five_bar.first_joint: 1", "limb LF", "parallel"),
    _five_bar("a five-bar behind the last joint", {"first_joint": 6}, "five_bar.first_joint: 6", "of 6"),
    _five_bar("a five-bar of half a joint", {"first_joint": 2.5}, "five_bar.first_joint: 2.5", "behind"),
    _five_bar("a crank that bends nowhere", {"bends": 0.5}, "five_bar.bends: 0.5", "1 or -1"),
    _five_bar("a rod too short", {"rod_m": 0.01}, "five_bar.least_sine", "limb LF", "0.2"),
    _five_bar("no torque of a five-bar", {}, "transmissions.torque_Nm", "2 and 3", limits=_SPEEDS),
    _five_bar("no speed of a five-bar", {}, "transmissions.speed_rad_s", "2 and 3", limits=_TORQUES),
    _five_bar("a belt about a crank", {}, "transmissions.coupled_to[3]", "3", "crank", limits=_LIMITS + _ABOUT_CRANK),
    _five_bar("a crank that cannot turn", {}, "low_rad", "joint 2 of limb LF", limits=_LIMITS + _CRANK_STANDS),
    _yaml("unknown key", "rate_Hz: 500", "rate_hz: 500", "can.rate_hz", "unknown key"),
    _yaml("missing key", "  unload_force_N: 4\n", "\n", "control.unload_force_N", "is missing"),
    _yaml("a pull too quick", " rate_N_s: 200", " rate_N_s: 600", "grasp_test.rate_N_s: 600", "at most 500"),
    _yaml("a pull that never begins", "press_s: 0.2", "press_s: 30", "grasp_test.press_s: 30", "in 0.02..5 s"),
    _yaml("a key of no value", "version: 1", "version:", "robot.yaml:3: version: nothing", "in 1..1"),
    _yaml("missing section", "drive:", "driver:", "driver", "unknown key"),
    _yaml("a text for a number", "rate_Hz: 500", "rate_Hz: fast", 'can.rate_Hz: "fast"', "expected a number"),
    _yaml("a quoted number", "rate_Hz: 500", 'rate_Hz: "500"', 'can.rate_Hz: "500"', "expected a number"),
    _yaml("a hexadecimal number", "rate_Hz: 500", "rate_Hz: 0x10", 'can.rate_Hz: "0x10"', "expected a number"),
    _yaml("a number for a name", "name: scaler", "name: 5", "name: 5", "expected a text"),
    _yaml("nan", "rate_Hz: 500", "rate_Hz: .nan", "can.rate_Hz: .nan", "not a finite number"),
    _yaml("infinite", "supply_V: 24", "supply_V: .inf", "drive.supply_V: .inf", "not a finite number"),
    _yaml("huge", "supply_V: 24", "supply_V: 1e300", "drive.supply_V: 1e300", "1e+09"),
    _yaml("zero rate", "rate_Hz: 500", "rate_Hz: 0", "can.rate_Hz: 0", "expected a number in"),
    _yaml("negative", "stiffness_N_m: 20000", "stiffness_N_m: -1", "gripper.stiffness_N_m: -1", "expected a number in"),
    _yaml("no whole number", "watchdog_cycles: 5", "watchdog_cycles: 5.5", "can.watchdog_cycles: 5.5", "whole number"),
    _yaml("short list", "[90, 90, 90, 60, 60, 60]", "[90, 90]", "servo.position_gain_Nm_rad: a list of 2"),
    _yaml("interval", "[0.165, 0.21]", "[0.21, 0.165]", "body.height_m: [0.21, 0.165]", "low below high"),
    _yaml(
        "a radius in millimetres",
        "pad_radius_m: 0.012",
        "pad_radius_m: 12",
        "gripper.pad_radius_m: 12",
        "millimetres: 0.012?",
    ),
    _yaml(
        "a tilt in degrees",
        "max_tilt_rad: 0.2",
        "max_tilt_rad: 20",
        "body.max_tilt_rad: 20",
        "looks like degrees: 0.349066?",
    ),
    _yaml("missing limb", "  RR: {bus: 3, prefix: RR}\n", "", "limbs.RR", "is missing"),
    _yaml("one bus twice", "RF: {bus: 1", "RF: {bus: 0", "limbs.RF.bus: 0", "a bus of its own"),
    _yaml("one prefix twice", "prefix: RF", "prefix: LF", 'limbs.RF.prefix: "LF"', "a prefix of its own"),
    _yaml("unknown prefix", "prefix: LF", "prefix: XX", "link XX_gripper", "no such link"),
    _yaml("three joints", "joint4, joint5, joint6]", "]", "limb.joints", "expected a list of 4 to 7 names"),
    _yaml("joints swapped", "[joint1, joint2,", "[joint2, joint1,", "can.nodes.joint2", "expected 1"),
    _yaml("node number", "joint3: 3", "joint3: 4", "can.nodes.joint3: 4", "expected 3"),
    _yaml("gripper's number", "gripper: 7", "gripper: 8", "can.nodes.gripper: 8", "expected 7"),
    _yaml("unknown gripper", "gripper_frame: gripper", "gripper_frame: hand", "link LF_hand", "no such link"),
    _yaml("unknown finger", "[finger1_slide,", "[thumb,", "joint LF_thumb", "prismatic joint on LF_gripper"),
    _yaml("fingers swapped", "[finger1_slide, finger2_slide]", "[finger2_slide, finger1_slide]", "along 1 0 0"),
    _yaml("opening", "opening_m: [0.008, 0.066]", "opening_m: [0.008, 0.05]", "LF_finger1_slide", "0.008..0.05"),
    _yaml("open", "open_opening_m: 0.048", "open_opening_m: 0.48", "gripper.open_opening_m: 0.48", "0.008..0.066"),
    _yaml("poles", "pole_pairs: 7", "pole_pairs: 70", "motor.pole_pairs: 70", "1..50"),
    _yaml("efficiency", "gear_efficiency: 0.9", "gear_efficiency: 1.1", "motor.gear_efficiency: 1.1", "..1"),
    _yaml("supply", "supply_V: 24", "supply_V: 11", "drive.supply_V: 11", "motor's continuous current"),
    _yaml("current", "continuous_current_A: 5.0", "continuous_current_A: 1.4", "at least 1.48, for the 2.4 Nm"),
    _yaml("rotor", "max_speed_rad_s: 700", "max_speed_rad_s: 170", "motor.max_speed_rad_s: 170", "more than the 172.8"),
    _yaml("screw", "screw_efficiency: 0.3", "screw_efficiency: 0.6", "gripper_motor.screw_efficiency: 0.6", "0.5"),
    _yaml("travel", "coarse_travel_m: 0.065", "coarse_travel_m: 0.05", "more than the travel of the fingers, 0.058"),
    _yaml("gains", "  damping_Ns_m: 400", "  damping_Ns_m: 100", "admittance.damping_Ns_m: 100", "at least 322.6"),
    _yaml("turning gains", "rotational_damping_Nms_rad: 9", "rotational_damping_Nms_rad: 1.5", "environment_Nm_rad"),
    _yaml(
        "joint gains",
        "[1.4, 1.4, 1.4, 0.6, 0.6, 0.6]",
        "[4, 4, 4, 1, 1, 1]",
        "servo.velocity_gain_Nms_rad: [4, 4, 4, 1, 1, 1]: a delay margin of 0.0034 s",
        "2 times dead_time_s, as with [1.39, 1.39, 1.39, 0.349",
    ),
    _yaml("dead time", "dead_time_s: 0.004", "dead_time_s: 0.006", "0.012", "position_gain_Nm_rad ["),
    _yaml("delay", "delay_s: 0.021", "delay_s: 0.16", "admittance.delay_s: 0.16", "at most 0.128"),
]
OF_NUMBERS = [
    Case("all in millimetres", URDF, _in_millimetres, ("link base", 'size="300 220 60"', "are these millimetres?")),
    _urdf("shoulder in millimetres", 'xyz="0.1355 0.144 0"', 'xyz="135.5 144 0"', "LF_joint1", "millimetres?"),
    _urdf("link in centimetres", ARM, ARM.replace("0.15", "15"), "LF_joint3", "at most 3 m"),
    _urdf("degrees", 'lower="-1.9" upper="1.9"', 'lower="-110" upper="110"', "LF_joint1", "are these degrees?"),
    _urdf("yaw in degrees", "0 0 1.570796326794897", "0 0 90", "LF_joint1", "are these degrees?"),
    _urdf("grams", 'mass value="2.8"', 'mass value="2800"', "link base", "are these grams?"),
    _urdf("no number", 'mass value="2.8"', 'mass value="heavy"', 'link base: value="heavy"', "1 finite number"),
    _urdf("nan mass", 'mass value="2.8"', 'mass value="nan"', 'link base: value="nan"', "1 finite number"),
    _urdf("infinite mass", 'mass value="2.8"', 'mass value="1e999"', 'link base: value="1e999"', "1 finite number"),
    _urdf("huge place", 'xyz="0.15 0 0"', 'xyz="1e300 0 0"', "LF_joint3", "at most 3 m"),
    _urdf("two numbers", 'xyz="0.15 0 0"', 'xyz="0.15 0"', "LF_joint3", 'xyz="0.15 0"', "3 finite numbers"),
    _urdf("negative mass", 'mass value="2.8"', 'mass value="-1"', "link base: -1", "expected a mass"),
    _urdf("massless body", 'mass value="2.8"', 'mass value="0"', "link base: mass 0", "this link moves"),
    _in("link LF_link3", "massless link", 'mass value="0.35"', 'mass value="0"', "link LF_link3: mass 0", "moves"),
    _urdf("no mass", '<mass value="2.8"/>', "", "link base", "needs the attribute value"),
    _urdf(
        "impossible inertia", 'ixx="0.012"', 'ixx="9"', "link base", "0.02, 0.03, 9", "below the sum of the two others"
    ),
    _urdf("a flat inertia", 'izz="0.03"', 'izz="0.032"', "link base", "below the sum of the two others"),
    _urdf("indefinite inertia", 'ixy="0"', 'ixy="0.5"', "link base", "expected all of them above 0"),
    _urdf("negative inertia", 'ixx="0.012"', 'ixx="-0.012"', "link base", "expected all of them above 0"),
    _urdf("no inertia", '<inertia ixx="0.012" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"/>', "", "link base: pri"),
    _urdf(
        "inertia in kg mm2",
        'ixx="0.012" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.03"',
        'ixx="12000" iyy="20000" izz="30000"',
        "link base",
        "are these kg mm2?",
    ),
    _urdf("no axis", '<axis xyz="0 -1 0"/>', '<axis xyz="0 0 0"/>', "joint LF_joint2", "axis 0 0 0", "a direction"),
    _urdf("no limit", '<limit lower="-1.9" upper="1.9" effort="12" velocity="4.8"/>', "", "LF_joint1", "needs a limit"),
    _urdf("no effort", ' effort="12"', "", "LF_joint1", "needs the attribute effort"),
    _urdf("zero effort", ' effort="12"', ' effort="0"', "LF_joint1", "effort 0", "positive limits"),
    _urdf("zero velocity", 'velocity="4.8"', 'velocity="0"', "LF_joint1", "velocity 0", "positive limits"),
    _urdf("negative velocity", 'velocity="4.8"', 'velocity="-1"', "LF_joint1", "velocity -1", "positive limits"),
    _urdf("huge effort", ' effort="12"', ' effort="1e30"', "LF_joint1", "at most 10000 Nm"),
    _urdf("limits swapped", 'lower="-1.9" upper="1.9"', 'lower="1.9" upper="-1.9"', "LF_joint1: 1.9..-1.9", "lower"),
    _urdf("box of two", '<box size="0.30 0.22 0.06"/>', '<box size="0.3 0.2"/>', 'link base: size="0.3 0.2"', "3 f"),
    _urdf("no radius", 'cylinder radius="0.02"', 'cylinder radius="0"', 'link LF_link2: radius="0"', "above 0"),
    _urdf("no shape", '<cylinder radius="0.02" length="0.15"/>', "", "link LF_link2", "expected box, sphere"),
    _urdf(
        "mesh",
        '<cylinder radius="0.02" length="0.15"/>',
        '<mesh filename="package://a/b.stl"/>',
        "link LF_link2: <mesh> package://a/b.stl",
        "what collides is",
    ),
]
OF_THE_TREE = [
    _urdf("link twice", '<link name="LF_link1">', '<link name="base">', "link base", "expected once"),
    _urdf("joint twice", '<joint name="LF_joint2"', '<joint name="LF_joint1"', "joint LF_joint1", "expected once"),
    _urdf("nameless link", '<link name="LF_link1">', "<link>", "link", "needs the attribute name"),
    _urdf("unknown parent", '<parent link="LF_link1"/>', '<parent link="nowhere"/>', "LF_joint2: nowhere: no such"),
    _urdf("missing link", '<link name="LF_link5">', '<link name="LF_links">', "LF_joint5: LF_link5: no such link"),
    _urdf("no child", '<child link="LF_link1"/>', "", "LF_joint1", "needs the attribute link"),
    _urdf("wrong parent", '<parent link="LF_link2"/>', '<parent link="LF_link1"/>', "limb LF", "expected the joints"),
    _urdf("another limb's", '<parent link="RF_link2"/>', '<parent link="LF_link2"/>', "limb RF", "expected the joints"),
    _urdf("cycle", '<parent link="base"/>', '<parent link="LF_gripper"/>', "link LF_link1", "to hang on base"),
    _urdf("child twice", '<child link="LF_link2"/>', '<child link="LF_link1"/>', "LF_joint2: LF_link1", "LF_joint1 al"),
    _added("below a foot", '<link name="foot"/>' + _fixed("up", "foot", "base"), "joint up: base", "no joint above"),
    _added("loose link", '<link name="loose"/>', "link loose", "to hang on base"),
    _added(
        "another mass",
        f'<link name="camera">{INERTIAL.format(0.2)}</link>' + _fixed("camera", "base", "camera"),
        "link camera: mass 0.2",
        "add it to the link it is fixed to",
    ),
    _added(
        "another motor",
        '<link name="tail"/>' + _fixed("wag", "base", "tail").replace("fixed", "continuous"),
        "joint wag: continuous",
        "expected fixed",
    ),
    _urdf("mimic", '<axis xyz="0 -1 0"/>', '<axis xyz="0 -1 0"/><mimic joint="LF_joint1"/>', "LF_joint2: mimic"),
    _urdf("unknown kind", 'type="revolute"', 'type="ball"', "joint LF_joint1: ball", "expected revolute, prismatic"),
]
OF_THE_LIMBS = [
    _urdf("prismatic joint", 'type="revolute"', 'type="prismatic"', "joint LF_joint1: prismatic", "expected revolute"),
    _urdf("continuous joint", 'type="revolute"', 'type="continuous"', "joint LF_joint1: continuous", "revolute"),
    _urdf("fixed joint", 'type="revolute"', 'type="fixed"', "limb LF", "expected the joints LF_joint1, LF_joint2"),
    _urdf("moving gripper", 'name="LF_mount" type="fixed"', 'name="LF_mount" type="continuous"', "limb LF", "LF_mount"),
    _in("joint RF_joint1", "wrong side", "0.1355 -0.144", "0.1355 0.144", "RF_joint1", "y below 0 for limb RF"),
    _in("joint LR_joint1", "wrong end", "-0.1355 0.144", "0.1355 0.144", "LR_joint1", "x below 0 and y above 0"),
]
OF_THE_FINGERS = [
    _urdf("revolute finger", FINGER, 'type="revolute"', "LF_finger1_slide: revolute along 1 0 0", "expected prismatic"),
    _all("revolute fingers", FINGER, 'type="revolute"', "LF_finger1_slide: revolute along 1 0 0", "expected prismatic"),
    _in("joint LF_finger1_slide", "finger along y", AXIS, '<axis xyz="0 1 0"/>', "prismatic along 0 1 0", "1 0 0"),
    _in("joint LF_finger1_slide", "finger backwards", AXIS, '<axis xyz="-1 0 0"/>', "prismatic along -1 0 0", "1 0 0"),
    _in("joint LF_finger2_slide", "finger off", 'xyz="0 0 0"', 'xyz="0.01 0 0"', "LF_finger2_slide: xyz 0.01 0 0"),
    _in("joint LF_finger1_slide", "finger turned", 'rpy="0 0 0"', 'rpy="0 0 1.57"', "rpy 0 0 1.57", "opening counts"),
    _in("joint RR_finger2_slide", "finger's travel", "0.066", "0.06", "RR_finger2_slide: 0.008..0.06", "opening_m"),
    _in("joint LF_finger1_slide", "finger on the wrist", "LF_gripper", "LF_link6", "prismatic joint on LF_gripper"),
]
BROKEN = [*OF_THE_FILES, *OF_ROBOT_YAML, *OF_NUMBERS, *OF_THE_TREE, *OF_THE_LIMBS, *OF_THE_FINGERS]

ALRIGHT = [
    _yaml("nothing but a comment", "version: 1", "# mine\nversion: 1"),
    _yaml("a number in another form", "rate_Hz: 500", "rate_Hz: 5.0e+2"),
    _yaml("leading zeros", "watchdog_cycles: 5", "watchdog_cycles: 010"),
    _yaml("a key left out that has a default", "  press_s: 0.2\n", ""),
    Case("a section left out whose keys all have one", YAML, _untested, ()),
    _yaml("another speed", "max_finger_speed_m_s: 0.02", "max_finger_speed_m_s: 0.01"),
    _transmissions("gears", "ratio: [-1, 1.2, 1, 1, 0.9, 1]"),
    _transmissions("actuators with less torque", "torque_Nm: [9, 9, 9, 5, 5, 5]"),
    Case("a coupling", YAML, _coupled, ()),
    _all("axes of any length", '<axis xyz="0 -1 0"/>', '<axis xyz="0 -2 0"/>'),
    _all("longer limbs", ARM, ARM.replace("0.15", "0.17")),
    _urdf("another mass", 'mass value="2.8"', 'mass value="3.1"'),
    _urdf("a turned inertia", '<origin xyz="0 0 0"/>', '<origin xyz="0 0 0.01" rpy="0.1 0.2 0.3"/>'),
    _in("link LF_gripper", "an inertia as large as allowed, but for rounding", HELD, SPREAD),
    _added("a frame", '<link name="camera"/>' + _fixed("camera", "base", "camera")),
    _added("what others read", '<transmission name="x"><type>any</type></transmission><gazebo reference="base"/>'),
    Case("axes turned around", URDF, _against, ()),
    Case("a fixed joint in between", URDF, _in_between, ()),
    _in("joint LF_mount", "no axis on what stands still", "</joint>", '<axis xyz="0 0 0"/></joint>'),
    _urdf("an axis turned around", '<axis xyz="0 -1 0"/>', '<axis xyz="0 1 0"/>'),
    Case("turned in between", URDF, _turned_in_between, ()),
    _urdf("an axis across", '<axis xyz="0 -1 0"/>', '<axis xyz="1 0 0"/>'),
    _in("joint LF_joint2", "a shoulder offset", '<origin xyz="0 0 0"', '<origin xyz="0.01 0 0"'),
    _in("joint LF_joint5", "a wrist offset", '<origin xyz="0 0 0"', '<origin xyz="0.02 0 0"'),
    _urdf("an elbow aside", ARM, ARM.replace("0.15 0 0", "0.15 0.1 0")),
    _urdf("a tilted shoulder", 'rpy="0 0 1.57', 'rpy="0.2 0 1.57'),
    _urdf("a gripper aside", 'xyz="0 0 -0.12"', 'xyz="0.01 0 -0.12"'),
    _urdf("a tilted gripper", 'xyz="0 0 -0.12" rpy="0', 'xyz="0 0 -0.12" rpy="0.1'),
    _in("joint RR_joint4", "a longer lower link", "0.2 0 0", "0.21 0 0"),
    _in("joint LR_joint1", "a shoulder elsewhere", "-0.1355 0.144", "-0.12 0.144"),
    _in("joint RF_joint1", "limits not mirrored", 'lower="-1.9"', 'lower="-1.5"'),
    _urdf("an unknown material", '<material name="body"/>', '<material name="velvet"/>'),
]
