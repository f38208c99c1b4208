"""A URDF like that of SCALER's makers: their frames, lengths and names [S], a five-bar cut open, meshes that are not
there, a mark between the pads. And the mapping that brings it in.
"""

from __future__ import annotations

from math import pi
from pathlib import Path

MAPPING = """name: makers
like: scaler
body_link: BodyLeft_Link
locked: {BodyTopleft_Joint: 0, BodyRight_Joint: 0, "A_Joint{}": 0, "B_Joint{}": 0}
limbs: {LF: 0, RF: 1, LR: 3, RR: 2}
joints: ["Shoulder_Joint{}", "F_Joint{}", "E_Joint{}", "wrist1_Joint{}", "wrist2_Joint{}", "wrist3_Joint{}"]
gripper: {link: "base_link_gripper{}", origin_m: [0, 0, -0.048]}
fingers: ["base_joint_gripper_left{}", "base_joint_gripper_right{}"]
limits_rad: {Shoulder_Joint: [-1.5, 1.5], F_Joint: [0.5, 2.8], E_Joint: [-1.72, 0.97], wrist1_Joint: [-1, 1],
             wrist2_Joint: [-0.3, 1.45], wrist3_Joint: [-1.6, 1.6]}
effort_Nm: {default: 4.1, F_Joint: 8.2, E_Joint: 8.2}
speed_rad_s: {default: 4.8}
finger: {effort_N: 60, speed_m_s: 0.02, opening_m: [0.01, 0.065]}
masses_kg: {total: 9.6, body: 2.8}
capsule_radius_m: 0.02
set: {body.height_m: [0.23, 0.30], servo.velocity_gain_Nms_rad: [1.1, 1.1, 1.1, 0.48, 0.48, 0.48],
      servo.position_gain_Nm_rad: [60, 60, 60, 40, 40, 40]}
"""


def makers_files(folder: Path) -> tuple[Path, Path]:
    """The URDF and the mapping, written."""
    urdf, mapping = folder / "makers.urdf", folder / "mapping.yaml"
    urdf.write_text(f'<robot name="makers">\n{_body()}{"".join(map(_limb, range(4)))}</robot>\n', encoding="utf-8")
    mapping.write_text(MAPPING, encoding="utf-8")
    return urdf, mapping


def _link(name: str, mass: float, com: str = "0 0 0", shape: str = "") -> str:
    inertia = f'<inertia ixx="{mass / 2e3}" iyy="{mass / 2e3}" izz="{mass / 2e3}" ixy="0" ixz="0" iyz="0"/>'
    weighs = f'<inertial><origin xyz="{com}"/><mass value="{mass}"/>{inertia}</inertial>' if mass else ""
    solid = shape or f'<mesh filename="{name}.STL"/>'
    return f'<link name="{name}">{weighs}<visual><geometry>{solid}</geometry></visual></link>\n'


def _joint(name: str, kind: str, parent: str, child: str, xyz: str, rpy: tuple[float, ...] = (0, 0, 0)) -> str:
    about = {"continuous": '<axis xyz="0 0 1"/>', "fixed": '<axis xyz="0 0 0"/>', "prismatic": '<axis xyz="0 1 0"/>'}
    slides = "-0.065", "-0.01"
    if "right" in name:
        slides = "0.01", "0.065"
    limit = f'<limit lower="{slides[0]}" upper="{slides[1]}" effort="0" velocity="0"/>' * (kind == "prismatic")
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{about[kind]}{limit}</joint>\n'


def _body() -> str:
    """Two halves, whose links are a parallelogram."""
    links = _link("BodyLeft_Link", 0.4, "-0.05 0 0") + _link("BodyTopleft_Link", 0.05) + _link("BodyRight_Link", 0.4)
    left = _joint("BodyTopleft_Joint", "continuous", "BodyLeft_Link", "BodyTopleft_Link", "-0.05 0.0742 0")
    right = _joint("BodyRight_Joint", "continuous", "BodyTopleft_Link", "BodyRight_Link", "0.1 0.0012 0")
    return links + left + right


def _limb(n: int) -> str:
    shoulder = ("0.0855 0.07001 0", "0.0855 -0.21849 0", "-0.1355 -0.14425 0", "-0.1355 0.14425 0")[n]
    body, side = ("BodyRight_Link" if n < 2 else "BodyLeft_Link"), (1 if n in (0, 3) else -1)
    aside = "-0.03 0 0.075" if n in (0, 2) else "0.03 0 0.075"
    mark = '<box size="0.01 0.01 0.01"/>'
    links = (
        (f"Shoulder_Link{n}", 0.15, "0 0 -0.07", ""), (f"A_Link{n}", 0.02, "0.05 0 0", ""),
        (f"B_Link{n}", 0.02, "0.07 0 0", ""), (f"F_Link{n}", 0.02, "0.05 0 0", ""),
        (f"E_Link{n}", 0.13, "0.1 0 0", ""), (f"wrist1_Link{n}", 0.01, "0 0 0", ""),
        (f"wrist2_Link{n}", 0.08, "0 0 0", ""), (f"wrist3_Link{n}", 0.01, "0 0 0.04", ""),
        (f"base_link_gripper{n}", 0.06, "0 0 -0.01", ""), (f"left_finger{n}", 0.02, "0 0 0.01", ""),
        (f"right_finger{n}", 0.02, "0 0 0.01", ""), (f"mark{n}", 0.0, "0 0 0", mark),
    )  # fmt: skip
    half, gripper = pi / 2, f"base_link_gripper{n}"
    joints = (
        (f"Shoulder_Joint{n}", "continuous", body, f"Shoulder_Link{n}", shoulder, (0, 0, side * half)),
        (f"A_Joint{n}", "continuous", f"Shoulder_Link{n}", f"A_Link{n}", "-0.0105 0 -0.0713", (half, half, 0)),
        (f"B_Joint{n}", "continuous", f"A_Link{n}", f"B_Link{n}", "0.113 0 0", (0, 0, 1.1965)),
        (f"F_Joint{n}", "continuous", f"Shoulder_Link{n}", f"F_Link{n}", "-0.0105 0 -0.0998", (half, 0, 0)),
        (f"E_Joint{n}", "continuous", f"F_Link{n}", f"E_Link{n}", "0.113 0 0", (0, 0, -1.17617)),
        (f"wrist1_Joint{n}", "continuous", f"E_Link{n}", f"wrist1_Link{n}", "0.21755 -0.0001 0", (-half, 0, 0)),
        (f"wrist2_Joint{n}", "continuous", f"wrist1_Link{n}", f"wrist2_Link{n}", "0 0 0", (half, half, pi)),
        (f"wrist3_Joint{n}", "continuous", f"wrist2_Link{n}", f"wrist3_Link{n}", "0 0 0", (half, half, 0)),
        (f"hand{n}", "fixed", f"wrist3_Link{n}", gripper, aside, (pi, 0, half)),
        (f"base_joint_gripper_left{n}", "prismatic", gripper, f"left_finger{n}", "0.008 -0.005 -0.0558",
         (half, -half, 0)),
        (f"base_joint_gripper_right{n}", "prismatic", gripper, f"right_finger{n}", "-0.0081 -0.007 -0.051",
         (half, -half, 0)),
        (f"marked{n}", "fixed", gripper, f"mark{n}", "0 0 -0.048"),
    )  # fmt: skip
    return "".join(_link(*link) for link in links) + "".join(_joint(*joint) for joint in joints)
