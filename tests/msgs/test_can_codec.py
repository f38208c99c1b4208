from __future__ import annotations

import pytest
from crux_contracts import can_codec
from crux_contracts.can_codec import CanCodecError, Frame, Receiver, Verdict
from hypothesis import given
from hypothesis import strategies as st


def test_crc_is_the_catalogue_crc16() -> None:
    # CRC-16/IBM-3740 of "123456789" is 0x29B1; the last two digits come in through the identifier.
    assert can_codec.crc(ord("8") | ord("9") << 8, b"\0\x001234567") == 0x29B1


@given(
    position=st.floats(-10, 10, width=32),
    torque=st.floats(-32, 32),
    counter=st.integers(0, 255),
    node=st.sampled_from(can_codec.JOINT_NODES),
    bit=st.integers(0, 127),
)
def test_joint_commands_survive_the_wire_and_flipped_bits_do_not(
    position: float, torque: float, counter: int, node: int, bit: int
) -> None:
    frame = can_codec.encode("JointCommand", {"Position_rad": position, "Torque_Nm": torque}, counter, node)
    values = can_codec.decode(frame).values
    assert values["Position_rad"] == position
    assert values["Torque_Nm"] == pytest.approx(torque, abs=0.000501)
    data = bytearray(frame.data)
    data[bit // 8] ^= 1 << bit % 8
    assert can_codec.check(Frame(frame.identifier, bytes(data)), Receiver()) is Verdict.CORRUPT


def test_counters_tell_next_lost_and_repeated() -> None:
    receiver = Receiver()
    verdicts = [can_codec.check(can_codec.encode("Sync", {}, c), receiver) for c in (254, 255, 0, 0, 3, 4)]
    assert [v.name for v in verdicts] == ["OK", "OK", "OK", "REPEATED", "LOST", "OK"]


def test_short_frames_are_corrupt() -> None:
    assert can_codec.check(Frame(16, b"\1\2"), Receiver()) is Verdict.CORRUPT


@pytest.mark.parametrize(
    ("name", "values", "node", "says"),
    [
        ("JointCommand", {"Torque_Nm": 99.0}, 3, "Torque_Nm"),
        ("JointCommand", {"Torque": 1.0}, 3, "no signal Torque"),
        ("JointCommand", {}, 7, "no message Joint7Command"),
        ("Nonsense", {}, None, "no message Nonsense"),
    ],
)
def test_misuse_is_told(name: str, values: dict[str, float | int], node: int | None, says: str) -> None:
    with pytest.raises(CanCodecError, match=says):
        can_codec.encode(name, values, 0, node)


def test_unknown_and_short_frames_are_told() -> None:
    with pytest.raises(CanCodecError, match="0x123"):
        can_codec.decode(Frame(0x123, bytes(8)))
    with pytest.raises(CanCodecError, match="0x010"):
        can_codec.decode(Frame(0x10, bytes(3)))
