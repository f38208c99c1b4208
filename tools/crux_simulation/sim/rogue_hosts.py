"""Frames on a bus that nobody of the robot has sent: old, guessed, of a second runtime, or statuses nobody measured.

The commands have a right CRC: they are what a stuck gateway, a replay or a second computer would send. They are as bad
as commands can be: every joint to zero at once, the gripper open.
"""

from __future__ import annotations

import random
from collections.abc import Iterator

from crux_contracts import can_codec
from crux_contracts.can_codec import Frame, Values

JOINT_NODES = can_codec.JOINT_NODES
GRIPPER = can_codec.GRIPPER_NODE
TRACK = 1
OPEN_M = 0.06
STALE_CYCLES = 20  # how old a replayed command is
OTHER_COUNTER = 128  # between the counters of the two masters: as far apart as they can be
COUNTERS, CYCLES = 256, 65536
TRACKS = 2  # DBC: JointStatus.State

_TO_ZERO: Values = {"Mode": TRACK, "Position_rad": 0.0, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 1.0}
_OPEN: Values = {"Mode": TRACK, "Opening_m": OPEN_M, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 60.0}


def _commands(counter: int) -> Iterator[Frame]:
    for node in JOINT_NODES:
        yield can_codec.encode("JointCommand", _TO_ZERO, counter % COUNTERS, node)
    yield can_codec.encode("GripperCommand", _OPEN, counter % COUNTERS)


def damaged(cycle: int) -> Iterator[Frame]:
    """Statuses with a wrong CRC: every joint at zero."""
    for node in JOINT_NODES:
        frame = can_codec.encode("JointStatus", {"State": TRACK, "CycleEcho": cycle % CYCLES}, cycle % COUNTERS, node)
        yield Frame(frame.identifier, bytes([frame.data[0] ^ 0xFF]) + frame.data[1:])


def stale(cycle: int) -> Iterator[Frame]:
    """Commands with the counters of some cycles ago."""
    yield from _commands(cycle - STALE_CYCLES)


def forged(cycle: int) -> Iterator[Frame]:
    """Commands of somebody who has to guess the counter; the same guesses in every run."""
    yield from _commands(random.Random(cycle).randrange(COUNTERS))


def ahead(cycle: int) -> Iterator[Frame]:
    """Commands of somebody who knows the host's counter, before the host's own."""
    yield from _commands(cycle + 1)


def second_master(cycle: int) -> Iterator[Frame]:
    """A second runtime that has started by itself: all its commands, and its own Sync."""
    yield from _commands(cycle + OTHER_COUNTER)
    yield can_codec.encode("Sync", {"Cycle": cycle}, (cycle + OTHER_COUNTER) % COUNTERS)


def second_node(cycle: int, node: int, broadcast: bool) -> Iterator[Frame]:
    """Statuses of a second board with the straps of `node`: a joint at zero, or a gripper half open that feels nothing.
    `broadcast`: the host commands all nodes in one frame, which a gripper answers in one."""
    counter = (cycle + OTHER_COUNTER) % COUNTERS
    status: Values = {"State": TRACKS, "CycleEcho": cycle % CYCLES}
    if node != GRIPPER:
        yield can_codec.encode("JointStatus", status, counter, node)
    elif broadcast:
        yield can_codec.encode("GripperAnswer", {**status, "Opening_m": OPEN_M / 2}, counter)
    else:
        yield can_codec.encode("GripperStatus", {**status, "Opening_m": OPEN_M / 2}, counter)
        yield can_codec.encode("ForceTorque", {"CycleEcho": cycle % CYCLES}, counter)


SENDERS = {"crc": damaged, "stale": stale, "forged": forged, "ahead": ahead, "second_master": second_master}
