"""The generator refuses contracts that contradict themselves, and its tables say what the YAML says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from crux_contracts import channels
from crux_contracts.can_codec import DBC
from crux_msgs import robot_state_t
from generate import can_c, lcm_types, robot_keys, tables
from generate.can_c import CanDatabaseError
from generate.lcm_types import LcmSyntaxError, parse_files
from generate.ros2msg import definition

MSGS = Path(__file__).resolve().parents[2] / "msgs"


def parse(tmp_path: Path, text: str) -> dict[str, lcm_types.Struct]:
    (tmp_path / "a.lcm").write_text(text)
    return parse_files([tmp_path / "a.lcm"])


def test_ros2msg_of_all_shapes(tmp_path: Path) -> None:
    structs = parse(
        tmp_path,
        """package p; /* two
        lines */ struct outer_box_t { const int8_t A = -1, B = 2; int32_t n; inner_t items[n]; inner_t one; byte raw[n];
        double x[3]; string s; } // end
        struct inner_t { int64_t a, b; }""",
    )
    assert list(structs) == ["inner_t", "outer_box_t"]
    assert definition(structs["outer_box_t"], structs).splitlines() == [
        "int8 A=-1", "int8 B=2", "int32 n", "p/Inner[] items", "p/Inner one", "uint8[] raw", "float64[3] x", "string s",
        "=" * 80, "MSG: p/Inner", "int64 a", "int64 b",
    ]  # fmt: skip
    assert structs["outer_box_t"].schema_name == "p/msg/OuterBox"


def test_constants_of_a_line_that_count_from_0_are_an_enumeration(tmp_path: Path) -> None:
    text = "package p; struct a_t { const int8_t NONE = -1, A = 0, B = 1; const int8_t C = 0, D = 1; }"
    assert parse(tmp_path, text)["a_t"].enumerations == [("C", "D")]


def test_states_are_named_as_the_message_numbers_them() -> None:
    for number, name in enumerate(channels.SUPERVISOR_STATES):
        assert getattr(robot_state_t, name) == number
    assert {"IDLE", "FAULT"} < set(channels.SUPERVISOR_STATES)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("package p; struct a_t { b_t x; }", "unknown type b_t"),
        ("package p; struct a_t { double x[n]; int32_t n; }", "length n must be a member before it"),
        ("package p; struct a_t { b_t x; } struct b_t { a_t x; }", "contains itself"),
        ("package p; struct a_t { const double X = 1; }", "constants must be integers"),
        ("package p; struct a_t { double x }", "expected ';', found '}'"),
        ("package p; struct a_t { double x; ", "found 'end of file'"),
        ("package p; union a_t { }", "expected 'package' or 'struct'"),
        ("package p; struct a_t { double $; }", ":1: unexpected character '\\$'"),
    ],
)
def test_lcm_mistakes_are_told(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(LcmSyntaxError, match=says):
        parse(tmp_path, text)


@pytest.mark.parametrize(
    ("pattern", "wrong", "says"),
    [
        (
            r"(BO_ 259 .*\n(?: SG_.*\n)*? SG_ Torque_Nm : 80\|16@1- \()0.001",
            r"\g<1>0.01",
            "Joint3Command: its layout differs",
        ),
        (r"BO_ 259 Joint3", "BO_ 999 Joint3", "identifiers must both count upwards"),
        (r"BO_ 262 Joint6Command", "BO_ 262 Joint7Command", "nodes and identifiers must both count"),
        (r'BA_ "VFrameFormat" BO_ 16 14;', 'BA_ "VFrameFormat" BO_ 16 0;', "Sync must be CAN FD"),
        (r"(BO_ 16 .*\n SG_ Crc : )0\|16@1\+", r"\g<1>7|16@0+", "Sync must begin with a 16-bit Crc"),
    ],
)
def test_can_databases_that_break_our_rules_are_refused(tmp_path: Path, pattern: str, wrong: str, says: str) -> None:
    text, count = re.subn(pattern, wrong, DBC.read_text(), count=1)
    assert count == 1
    if "999" in wrong:
        text = text.replace("BO_ 259 14", "BO_ 999 14").replace("_ 259 ", "_ 999 ")
    (tmp_path / "wrong.dbc").write_text(text)
    with pytest.raises(CanDatabaseError, match=says):
        can_c.collapse(can_c.load(tmp_path / "wrong.dbc"))


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ("type: fault_t", "type: nothing_t", "unknown type nothing_t"),
        ("topic: /fault", "topic: /plan", "share one topic"),
        ("CRUX_FAULT", "CRUX_PLAN", "share one name"),
        ("writer: tools", "writer: nobody", "is written by nobody"),
        ("version: 1", "version: 2", "version must be 1"),
        ("topic: /plan", "topic: /plan, per_limb: true", "plan_t has no member 'limb'"),
    ],
)
def test_channel_tables_that_contradict_themselves_are_refused(
    tmp_path: Path, right: str, wrong: str, says: str
) -> None:
    (tmp_path / "channels.yaml").write_text((MSGS / "channels.yaml").read_text().replace(right, wrong, 1))
    structs = parse_files(list((MSGS / "lcm").glob("*.lcm")))
    with pytest.raises(tables.TableError, match=says):
        tables.read_channels(tmp_path / "channels.yaml", structs)


def test_fault_tables_that_contradict_themselves_are_refused(tmp_path: Path) -> None:
    supervisor = parse_files([MSGS / "lcm/robot_state.lcm"])["robot_state_t"]
    text = (MSGS / "faults.yaml").read_text()
    (tmp_path / "f.yaml").write_text(text.replace("code: 2,", "code: 12,"))
    with pytest.raises(tables.TableError, match="without gaps"):
        tables.read_faults(tmp_path / "f.yaml", supervisor)
    (tmp_path / "f.yaml").write_text(text.replace("to: HOLDING", "to: PANIC", 1))
    with pytest.raises(tables.TableError, match="unknown state PANIC"):
        tables.read_faults(tmp_path / "f.yaml", supervisor)
    (tmp_path / "f.yaml").write_text(text.replace("(limit: {limit}", "(limit: {most}", 1))
    with pytest.raises(tables.TableError, match=r"the text of node_silent has \{'most'\}"):
        tables.read_faults(tmp_path / "f.yaml", supervisor)


@pytest.mark.parametrize(
    ("right", "wrong", "says"),
    [
        ("unit: kg, means: virtual mass", "unit: N, means: virtual mass", "mass_kg does not end with its unit, N"),
        ("type: per_joint", "type: per_finger", "per_finger is no type"),
        ("range: fraction", "range: percent", "percent"),
        ("key: noise_Nm, unit: Nm", "key: noise_N, unit: N", "there twice.*noise_N"),
        ("key: max_change", "name: max_change", "unexpected keyword argument 'name'"),
        ("includes: machine", "includes: engine", "engine"),
        ("default: 30", "default: 3000", "3000 is no default of it"),
    ],
)
def test_a_table_of_the_robots_keys_that_contradicts_itself_is_refused(
    tmp_path: Path, right: str, wrong: str, says: str
) -> None:
    text = (MSGS / "robot_keys.yaml").read_text()
    assert right in text
    (tmp_path / "keys.yaml").write_text(text.replace(right, wrong, 1))
    with pytest.raises(tables.TableError, match=says):
        robot_keys.read_robot_keys(tmp_path / "keys.yaml")


def test_python_sees_the_tables() -> None:
    assert channels.BY_NAME[channels.CRUX_ROBOT_STATE].topic == "/robot_state"
    assert channels.BY_TOPIC["/plan"].rate_Hz == channels.EVENT_RATE
    assert channels.SCHEMAS["limb_knot_t"].name == "crux_msgs/msg/LimbKnot"
    assert "MSG: crux_msgs/LimbKnot" in channels.SCHEMAS["plan_t"].definition
    fault = channels.FAULT_BY_CODE[7]
    assert (fault.name, fault.to) == ("body_error", "HOLDING")
    assert fault.describe(0.07, 0.06) == "body is 0.07 m off its reference (limit: 0.06 m)"
    jumped = channels.FAULT_BY_CODE[19].describe(-0.3, 0.012)
    assert jumped == "the encoder jumped by -0.3 rad in a cycle (the joint turns 0.012 rad at most)"


@pytest.mark.parametrize("fault", channels.FAULTS, ids=lambda fault: fault.name)
def test_a_fault_is_told_with_its_numbers(fault: channels.FaultKind) -> None:
    words = fault.describe(0.123, 0.456)
    assert ("0.123" in words) == ("{value}" in fault.text)
    assert ("0.456" in words) == ("{limit}" in fault.text)
    assert not re.search(r"[{}]|\bvalue\b|\blimit\b(?!: 0.456)", words)
