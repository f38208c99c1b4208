"""How long CAN FD frames occupy a bus, and how much of it a control cycle takes.

Bits of a frame with 11-bit identifier by ISO 11898-1: arbitration at the nominal rate, from BRS to the CRC delimiter at
the data rate. Dynamic stuffing depends on the content: the least and the most are given.
"""

from __future__ import annotations

from crux_contracts import can_codec
from crux_contracts.robot import Robot

NOMINAL_BITS = 17 + 13  # SOF, identifier, RRS, IDE, FDF, res, BRS; CRC delimiter, ACK, its delimiter, EOF, intermission
NOMINAL_STUFFED = 17  # of these the first part can be stuffed
DATA_HEADER_BITS = 1 + 4  # ESI, DLC
STUFF_COUNT_BITS = 4
SHORT_CRC, LONG_CRC = (17, 6), (21, 7)  # bits, fixed stuff bits about stuff count and CRC; up to 16 bytes, above
SHORT_BYTES = 16
STUFF_EVERY = 4  # after five equal bits one is put in, which may be the first of the next five
HEARTBEAT_HZ = 10.0
# Of the bus, in every control cycle. A broadcast is for rates at which commands for each node have no room at all.
BUDGET = {"each": 0.65, "broadcast": 0.75}
COMMANDS = {"each": ("Sync", "GripperCommand"), "broadcast": ("Broadcast",)}  # of the host, beside the joints' commands
ANSWERS = {"each": ("GripperStatus", "ForceTorque"), "broadcast": ("GripperAnswer",)}
JOINT_FRAMES = {"each": ("JointCommand", "JointStatus"), "broadcast": ("JointStatus",)}
LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


def frame_time_s(length: int, bit_rate: int, data_bit_rate: int) -> tuple[float, float]:
    """Least and most time of a frame with `length` payload bytes, rounded up to the next length CAN FD has."""
    padded = next(size for size in LENGTHS if size >= length)
    crc, fixed = SHORT_CRC if padded <= SHORT_BYTES else LONG_CRC
    data_bits = DATA_HEADER_BITS + 8 * padded + STUFF_COUNT_BITS + crc + fixed
    nominal_stuff = (NOMINAL_STUFFED - 1) // STUFF_EVERY
    all_stuff = (NOMINAL_STUFFED + DATA_HEADER_BITS + 8 * padded - 1) // STUFF_EVERY
    least = NOMINAL_BITS / bit_rate + data_bits / data_bit_rate
    return least, least + nominal_stuff / bit_rate + (all_stuff - nominal_stuff) / data_bit_rate


def planned_load(robot: Robot, commands: str = "each") -> tuple[float, float]:
    """Share of a limb's bus that the control cycle and the heartbeats take, least and most.

    `commands`: a frame for each node, or one broadcast for all.
    """
    per_cycle = (*COMMANDS[commands], *ANSWERS[commands])
    lengths = [(can_codec.message(name).length, robot.can.rate_Hz) for name in per_cycle]
    joints = can_codec.JOINT_NODES[: len(robot.limbs[0].joints)]
    for node in joints:
        lengths += [(can_codec.message(name, node).length, robot.can.rate_Hz) for name in JOINT_FRAMES[commands]]
    heartbeats = len(joints) + 2  # of the joints, the gripper and the host
    lengths.append((can_codec.message("HostHeartbeat").length, HEARTBEAT_HZ * heartbeats))
    times = [(frame_time_s(length, robot.can.bit_rate, robot.can.data_bit_rate), rate) for length, rate in lengths]
    return sum(time[0] * rate for time, rate in times), sum(time[1] * rate for time, rate in times)


def measured_load(interface: str, seconds: float, bit_rate: int, data_bit_rate: int) -> tuple[float, float, int]:
    """Share of the time that frames took on an interface while it was listened to, least and most, and their number."""
    import socket
    import time

    least = most = 0.0
    count = 0
    times = {length: frame_time_s(length, bit_rate, data_bit_rate) for length in LENGTHS}
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
        bus.bind((interface,))
        bus.settimeout(seconds)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            try:
                frame = bus.recv(72)
            except TimeoutError:
                break
            low, high = times[next(size for size in LENGTHS if size >= frame[4])]
            least, most, count = least + low, most + high, count + 1
    return least / seconds, most / seconds, count
