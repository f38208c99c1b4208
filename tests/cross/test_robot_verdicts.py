"""A robot description has one verdict, in the same words: of the Python reader, crux-runtime and `crux plan`."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from broken_robots import ALRIGHT, BROKEN, URDF, YAML, Case
from broken_scenarios import SCENARIO
from clear_message import check_message
from crux_contracts.robot import ROBOTS, RobotError, load_robot
from crux_tools import cli
from crux_tools.paths import built
from hypothesis import given, settings
from hypothesis import strategies as st

RUNTIME = built("runtime/app/crux-runtime")
OTHER_WORDS = ("is not YAML", "is not XML", "anchors and aliases", "tags (!)")  # the libraries', or less of the place
LONGER = re.compile(r"unknown key; .*|twice, first in line.*|expected a mapping with .*")  # in Python


def of_python(robot: Path) -> list[str]:
    """What the Python reader finds wrong; nothing where it takes the robot."""
    try:
        load_robot(robot)
    except RobotError as error:
        return str(error).splitlines()
    return []


def of_runtime(robot: Path) -> str:
    """What crux-runtime says is wrong, in one line; nothing where it takes the robot."""
    done = subprocess.run(
        [RUNTIME, "--robot", robot, "--check"],
        capture_output=True,
        text=True,
        errors="replace",
        timeout=60,
        check=False,
    )
    if done.returncode == 0:
        assert done.stdout.startswith(f"{robot}: robot scaler, ")
        assert done.stderr == ""
        return ""
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("crux-runtime: ")
    return lines[0].removeprefix("crux-runtime: ")


def test_there_are_enough_of_them() -> None:
    cases = [*BROKEN, *ALRIGHT]
    assert len({case.id for case in BROKEN}) == len(BROKEN) >= 100
    assert {case.file for case in cases} == {YAML, URDF}


@pytest.mark.parametrize("case", BROKEN, ids=lambda case: case.id)
def test_a_broken_robot_is_refused_by_all_in_the_same_words(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = case.write(tmp_path)
    found, said = of_python(robot), of_runtime(robot)
    assert found
    for name in case.names:
        assert name in said
        assert name in found[0]
    if not any(words in said for words in OTHER_WORDS):
        assert LONGER.sub("", found[0]) == LONGER.sub("", said).removesuffix("unknown key").removesuffix("twice")
    monkeypatch.setattr("crux_contracts.robot.ROBOTS", tmp_path)
    assert cli.main(["plan", str(SCENARIO), "-o", str(tmp_path / "plan.mcap")]) == 2
    printed, errors = capsys.readouterr()
    check_message(errors.splitlines()[0], "plan", *case.names)
    assert printed == ""
    assert not (tmp_path / "plan.mcap").exists()


@pytest.mark.parametrize("case", ALRIGHT, ids=lambda case: case.id)
def test_another_robot_is_taken_by_both(case: Case, tmp_path: Path) -> None:
    robot = case.write(tmp_path)
    assert of_python(robot) == []
    assert of_runtime(robot) == ""


def test_names_have_the_limb_where_they_say(tmp_path: Path) -> None:
    robot = tmp_path / "scaler"
    shutil.copytree(ROBOTS / "scaler", robot)
    urdf, yaml = (robot / name for name in (URDF, YAML))
    text = re.sub(r'"(LF|RF|LR|RR)_(\w+)"', r'"\2-\1"', urdf.read_text(encoding="utf-8"))
    urdf.write_text(text, encoding="utf-8")
    text = re.sub(r"\b(joint[1-6]|finger[12]_slide)\b", r'"\1-{}"', yaml.read_text(encoding="utf-8"))
    yaml.write_text(text.replace("gripper_frame: gripper", 'gripper_frame: "gripper-{}"'), encoding="utf-8")
    assert of_python(robot) == []
    assert of_runtime(robot) == ""
    assert load_robot(robot).limbs[1].joint_names[0] == "joint1-RF"


def test_the_inertia_of_a_turned_frame_is_the_same_in_its_axes(tmp_path: Path) -> None:
    import pinocchio

    case = next(case for case in ALRIGHT if case.id == "a turned inertia")
    robot = load_robot(case.write(tmp_path))
    model = pinocchio.buildModelFromUrdf(str(robot.urdf_path), pinocchio.JointModelFreeFlyer())
    xx, xy, xz, yy, yz, zz = robot.urdf.links["base"].inertia_kg_m2
    expected = model.inertias[1].inertia
    assert [xx, xy, xz, yy, yz, zz] == pytest.approx(
        [expected[i, j] for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))], abs=1e-12
    )


NUMBER = re.compile(r"(?<!<\?xml version=\")(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])")
WORDS = (
    "0",
    "-0",
    "-1",
    "1e-12",
    "1e-300",
    "1e300",
    "1e999",
    "nan",
    ".nan",
    ".inf",
    "inf",
    "",
    "x",
    "0x1",
    "1_0",
    "010",
)
FACTORS = (-1.0, 0.5, 0.999999, 1.0000001, 2.0, 10.0, 1000.0, 1e-3)


@st.composite
def changes(draw: st.DrawFn) -> tuple[str, int, str]:
    """A file, which of its numbers, and what then stands there."""
    file = draw(st.sampled_from([YAML, URDF]))
    count = len(NUMBER.findall((ROBOTS / "scaler" / file).read_text(encoding="utf-8")))
    change = draw(
        st.one_of(st.sampled_from(WORDS), st.sampled_from(FACTORS).map(lambda f: f"*{f}"), st.floats().map(repr))
    )
    return file, draw(st.integers(0, count - 1)), change


def check_numbers_changed(folder: Path, edits: list[tuple[str, int, str]]) -> None:
    """Both readers say the same of scaler with these numbers changed."""
    robot = folder / "robot"
    shutil.rmtree(robot, ignore_errors=True)
    shutil.copytree(ROBOTS / "scaler", robot)
    for file, index, change in edits:
        path = robot / file
        text = path.read_text(encoding="utf-8")
        numbers = list(NUMBER.finditer(text))
        number = numbers[index % len(numbers)]
        other = repr(float(number[0]) * float(change[1:])) if change.startswith("*") else change
        path.write_text(text[: number.start()] + other + text[number.end() :], encoding="utf-8")
    found, said = of_python(robot), of_runtime(robot)
    assert bool(found) == bool(said), (found, said)
    if said and not any(words in found[0] + said for words in OTHER_WORDS):
        assert LONGER.sub("", said).removesuffix("unknown key") in [LONGER.sub("", line) for line in found]


@settings(max_examples=30)
@given(edits=st.lists(changes(), min_size=1, max_size=3))
def test_any_numbers_have_one_verdict(
    edits: list[tuple[str, int, str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    check_numbers_changed(tmp_path_factory.getbasetemp(), edits)


@pytest.mark.sweep
@settings(max_examples=1500)
@given(edits=st.lists(changes(), min_size=1, max_size=3))
def test_many_numbers_have_one_verdict(
    edits: list[tuple[str, int, str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    check_numbers_changed(tmp_path_factory.getbasetemp(), edits)
