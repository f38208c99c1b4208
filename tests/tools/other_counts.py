"""The shipped robot with limbs of four, five or seven joints: what its URDF and robot.yaml have to change for it."""

from __future__ import annotations

import re
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

from crux_contracts import LIMB_NAMES
from crux_contracts.robot import ROBOTS

TWIST = """<robot><joint name="{0}_twist" type="revolute"><parent link="{0}_link2"/><child link="{0}_twisted"/>
<origin xyz="0.075 0 0" rpy="0 0 0"/><axis xyz="1 0 0"/>
<limit lower="-0.7" upper="0.9" effort="12" velocity="4.8"/></joint>
<link name="{0}_twisted"><inertial><origin xyz="0.03 0 0"/><mass value="0.2"/>
<inertia ixx="0.0002" ixy="0" ixz="0" iyy="0.0002" iyz="0" izz="0.0002"/></inertial></link></robot>"""


def with_joints(count: int, folder: Path, limbs: tuple[str, ...] = LIMB_NAMES, *, six: bool = False) -> Path:
    """A robot's folder `scaler` in `folder`. With four joints a limb yaws and pitches three times, with five it also
    turns its hand, with seven it also twists its upper link; limbs not named keep
    `six`.
    """
    robot = folder / "scaler"
    most = 6 if six else count
    shutil.copytree(ROBOTS / "scaler", robot)
    path = robot / "scaler.urdf"
    tree = ET.parse(path)
    for limb in limbs:
        _change(tree.getroot(), limb, count)
    tree.write(path)
    names = {4: "joint1, joint2, joint3, joint4", 5: "joint1, joint2, joint3, joint4, joint6"}
    names[6] = "joint1, joint2, joint3, joint4, joint5, joint6"
    names[7] = "joint1, joint2, twist, joint3, joint4, joint5, joint6"
    joints = names[most].split(", ")
    numbers = [n for n in range(1, 9) if n != 7]
    nodes = ", ".join(f"{joint}: {number}" for joint, number in zip(joints, numbers, strict=False))
    text = (robot / "robot.yaml").read_text()
    text = re.sub(r"joints: \[.*\]", f"joints: [{names[most]}]", text, count=1)
    text = re.sub(r"nodes: {.*}", f"nodes: {{{nodes}, gripper: 7}}", text)
    text = re.sub(r"\[([0-9.]+), ([^\[\]]*), ([0-9.]+)\](?= #)", lambda found: _list(found, most), text)
    (robot / "robot.yaml").write_text(text)
    return robot


def _list(found: re.Match[str], count: int) -> str:
    values = found[0].strip("[]").split(", ")
    if len(values) != 6:
        return found[0]
    return f"[{', '.join([values[0], *values] if count == 7 else values[:count])}]"


def _change(root: ET.Element, limb: str, count: int) -> None:
    def joint(name: str) -> ET.Element:
        found = root.find(f"joint[@name='{limb}_{name}']")
        assert found is not None
        return found

    def drop(name: str, link: str) -> None:
        gone = root.find(f"link[@name='{limb}_{link}']")
        assert gone is not None
        root.remove(joint(name))
        root.remove(gone)

    def hang(name: str, parent: str) -> None:
        above = joint(name).find("parent")
        assert above is not None
        above.set("link", f"{limb}_{parent}")

    if count == 7:
        root.extend(ET.fromstring(TWIST.format(limb)))
        hang("joint3", "twisted")
        _place(joint("joint3"), "xyz", "0.075 0 0")
        return
    drop("joint5", "link5")
    if count == 5:
        hang("joint6", "link4")
        return
    drop("joint6", "link6")
    hang("mount", "link4")
    ahead = "0 0 0" if limb[1] == "F" else "0 0 3.141592653589793"
    _place(joint("joint1"), "rpy", ahead)
    _place(joint("mount"), "rpy", ahead)


def _place(joint: ET.Element, key: str, value: str) -> None:
    origin = joint.find("origin")
    assert origin is not None
    origin.set(key, value)
