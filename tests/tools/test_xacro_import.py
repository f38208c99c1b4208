"""`crux robot import` of xacro: what it expands to comes in; what a file needs and is not there is told."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from crux_contracts.robot import load_robot
from crux_tools import cli
from crux_tools.paths import ROOT

MAKERS = ROOT / "examples" / "makers-scaler"
HEAD = '<robot name="makers" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def package(folder: Path, more: str = "") -> Path:
    """A ROS package whose file includes one of another package and names a mesh of it; the makers' URDF is in there."""
    (folder / "ws" / "scaler_description" / "urdf").mkdir(parents=True)
    (folder / "ws" / "scaler_limbs").mkdir()
    text = (MAKERS / "scaler.urdf").read_text()
    body = text[text.index("<link") : text.index("</robot>")]
    body = body.replace('value="0.25854"', 'value="${2 * $(arg half_kg)}"')  # the mass of the body's left half
    assert "half_kg" in body
    limbs = f'{HEAD}<xacro:macro name="whole">{body}</xacro:macro></robot>'
    (folder / "ws" / "scaler_limbs" / "limbs.xacro").write_text(limbs)
    (folder / "ws" / "scaler_description" / "package.xml").write_text(
        "<package><name>scaler_description</name></package>"
    )
    include = '<xacro:include filename="$(find scaler_limbs)/limbs.xacro"/><xacro:whole/>'
    path = folder / "ws" / "scaler_description" / "urdf" / "robot.xacro"
    path.write_text(f"{HEAD}{more}{include}</robot>")
    return path


def words(path: Path, folder: Path, *more: str) -> list[str]:
    mapping = str(MAKERS / "mapping.yaml")
    return ["robot", "import", str(path), "--mapping", mapping, "-o", str(folder / "made"), *more]


def test_macros_packages_and_arguments_are_expanded(tmp_path: Path) -> None:
    path = package(tmp_path)
    assert cli.main(words(path, tmp_path, "--xacro", "half_kg:=0.12927")) == 0
    one = ["robot", "import", str(MAKERS / "scaler.urdf"), "--mapping", str(MAKERS / "mapping.yaml")]
    assert cli.main([*one, "-o", str(tmp_path / "one")]) == 0
    for name in ("makers.urdf", "robot.yaml"):
        assert (tmp_path / "made" / name).read_text() == (tmp_path / "one" / name).read_text()
    assert load_robot(tmp_path / "made").name == "makers"


def test_what_a_xacro_file_lacks_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = package(tmp_path, '<xacro:property name="mass" value="$(arg half_kg) $(arg side)"/>')
    for name, given, said in (
        ("arguments", (), "arguments are missing: --xacro half_kg:=VALUE side:=VALUE"),
        ("one", ("--xacro", "half_kg=0.1"), "--xacro half_kg=0.1: expected NAME:=VALUE"),
        ("package", ("--xacro", "half_kg:=0.1", "--xacro", "side:=left"), "no package scaler_limbs: expected a folder"),
    ):
        if name == "package":
            (tmp_path / "ws" / "scaler_limbs").rename(tmp_path / "elsewhere")
        assert cli.main(words(path, tmp_path, *given)) == 2
        error = capsys.readouterr().err
        assert said in error, error
        assert not (tmp_path / "made").exists()


def test_without_the_package_xacro_it_says_how_to_have_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xacro", None)
    assert cli.main(words(package(tmp_path), tmp_path)) == 2
    assert "is xacro: install its package, `pip install xacro`" in capsys.readouterr().err
