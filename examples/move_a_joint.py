"""Moves one joint over CAN, without a runtime: some degrees from where it is, and back. The limb must hang free!

python examples/move_a_joint.py --interface socketcan --channel can0 --joint 3 --degrees 5

A node takes a command over when a Sync comes, and holds when five cycles pass without: so the joint stays held.
"""

import argparse
import math
import time
from collections import Counter

import can
from crux_contracts import can_codec

HOLD, TRACK, REARM = 0, 1, 2
FD = {"is_extended_id": False, "is_fd": True, "bitrate_switch": True}
GAINS = {"Kp_Nm_rad": 60.0, "Kd_Nms_rad": 3.0}
sent: Counter[str] = Counter()  # frames of a kind


def send(bus: can.BusABC, name: str, values: can_codec.Values, node: int | None = None) -> None:
    frame = can_codec.encode(name, values, sent[name], node)  # with counter and CRC
    sent[name] += 1
    bus.send(can.Message(arbitration_id=frame.identifier, data=frame.data, **FD))


def turn(bus: can.BusABC, node: int, command: can_codec.Values) -> float:
    """A cycle: command and Sync, then the joint's answer to it: the angle measured [rad]."""
    send(bus, "JointCommand", command, node)
    time.sleep(0.002)
    send(bus, "Sync", {"Cycle": (cycle := sent["Sync"])})
    while (message := bus.recv(timeout=1.0)) is not None:
        frame = can_codec.Frame(message.arbitration_id, bytes(message.data))
        if frame.identifier == can_codec.message("JointStatus", node).frame_id:
            status = can_codec.decode(frame).values
            if can_codec.check(frame, can_codec.Receiver()) is can_codec.Verdict.OK and status["CycleEcho"] == cycle:
                return status["Position_rad"]
    raise SystemExit(f"joint {node} does not answer: has it power?")


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--interface", default="socketcan")
    parser.add_argument("--channel", default="can0")
    parser.add_argument("--port", type=int, default=43113, help="of udp_multicast")
    parser.add_argument("--joint", type=int, default=1)
    parser.add_argument("--degrees", type=float, default=5.0)
    given = parser.parse_args(words)
    with can.Bus(interface=given.interface, channel=given.channel, port=given.port, fd=True) as bus:
        angles = [turn(bus, given.joint, {"Mode": REARM})]
        for step in range(1, 1001):  # two seconds and more
            wanted = angles[0] + math.radians(given.degrees) / 2 * (1 - math.cos(2 * math.pi * step / 1000))
            angles.append(turn(bus, given.joint, {"Mode": TRACK, "Position_rad": wanted, **GAINS}))
        turn(bus, given.joint, {"Mode": HOLD})
    print(f"from {angles[0]:.3f} rad, {max(angles) - min(angles):.3f} rad of way, to {angles[-1]:.3f} rad")


if __name__ == "__main__":
    main()
