"""`crux robot import` of a walking robot, whose legs have three joints and point feet: every reason at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from crux_tools import cli

INERTIAL = '<inertial><mass value="{}"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>'
LEGS = {"FL": "0.2 0.1", "FR": "0.2 -0.1", "HL": "-0.2 0.1", "HR": "-0.2 -0.1"}
MAPPING = """
name: dog
like: cat
body_link: torso
limbs: {LF: FL, RF: FR, LR: HL, RR: HR}
joints: ["{}_hip", "{}_thigh", "{}_calf"]
gripper: {link: "{}_foot"}
"""


def dog(folder: Path, trunk_kg: float = 5.0) -> Path:
    parts = [f'<robot name="dog"><link name="trunk">{INERTIAL.format(trunk_kg)}</link>']
    for leg, place in LEGS.items():
        links = ["trunk", *(f"{leg}_{name}" for name in ("hip_link", "thigh_link", "calf_link", "foot"))]
        for i, (name, axis) in enumerate((("hip", "1 0 0"), ("thigh", "0 1 0"), ("calf", "0 1 0"), ("sole", ""))):
            turns = f'<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="30" velocity="20"/>' if axis else ""
            parts.append(f'<link name="{links[i + 1]}">{INERTIAL.format(0.5)}</link>')
            parts.append(f'<joint name="{leg}_{name}" type="{"revolute" if axis else "fixed"}">')
            parts.append(f'<parent link="{links[i]}"/><child link="{links[i + 1]}"/>{turns}')
            parts.append(f'<origin xyz="{place + " 0" if i == 0 else "0 0 -0.2"}"/></joint>')
    path = folder / "dog.urdf"
    path.write_text("".join(parts) + "</robot>", encoding="utf-8")
    return path


def refused(urdf: Path, folder: Path, capsys: pytest.CaptureFixture[str], mapping: str = "") -> list[str]:
    """What `crux robot import` says, without its name."""
    words = ["robot", "import", str(urdf), "-o", str(folder / "dog")]
    if mapping:
        (folder / "mapping.yaml").write_text(mapping, encoding="utf-8")
        words += ["--mapping", str(folder / "mapping.yaml")]
    assert cli.main(words) == 2
    assert not (folder / "dog").exists()
    return [
        line.replace(f"{folder}/", "").removeprefix("crux robot: ") for line in capsys.readouterr().err.splitlines()
    ]


def test_legs_of_three_joints_without_fingers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = refused(dog(tmp_path), tmp_path, capsys, MAPPING)
    assert len(told) == 5
    starts = ("fingers: is missing", "joints: ['{}_hip', '{}_thigh', '{}_calf']: expected 4 to 7 names", "like: cat")
    for start in (*starts, "body_link: torso: no such link in the URDF; its root is trunk"):
        assert sum(line.startswith(f"mapping.yaml: {start}") for line in told) == 1, (start, told)
    assert told[-1].startswith("dog.urdf: joints that move: FL_hip (revolute), ")
    assert told[-1].endswith(
        "none slides: crux grips with two fingers that do, which it has to have; "
        "at most 3 turn one behind the other: a limb needs 4 at least, add its wrist"
    )


def test_what_is_wrong_with_the_urdf_comes_with_what_the_mapping_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = refused(dog(tmp_path, trunk_kg=5000.0), tmp_path, capsys)
    assert sum(line.startswith("MAPPING: ") for line in told) == 7
    assert [line for line in told if "grams" in line] == [
        'dog.urdf: link trunk: value="5000.0": expected at most 100 kg: are these grams?'
    ]


def floating(urdf: Path, parent: str, child: str) -> Path:
    """The same with a joint that floats, as simulators have between their world and the base of a robot."""
    joint = f'<joint name="free" type="floating"><parent link="{parent}"/><child link="{child}"/></joint>'
    path = urdf.with_name("free.urdf")
    path.write_text(urdf.read_text(encoding="utf-8").replace("</robot>", f'<link name="new"/>{joint}</robot>'))
    return path


def test_what_floats_above_the_body_does_not_hinder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    urdf = dog(tmp_path)
    for mapping in ("", MAPPING, MAPPING.replace("torso", "trunk")):
        plain = refused(urdf, tmp_path, capsys, mapping)
        free = refused(floating(urdf, "new", "trunk"), tmp_path, capsys, mapping)
        assert [line.replace("free.urdf", "dog.urdf") for line in free] == [
            line.replace("its root is trunk", "its root is new") for line in plain
        ]


def test_what_floats_on_the_robot_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = floating(dog(tmp_path), "trunk", "new")
    told = refused(path, tmp_path, capsys, MAPPING.replace("torso", "trunk"))
    assert "free.urdf: joint free: floating: expected revolute, prismatic, continuous or fixed" in told
