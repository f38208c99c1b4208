"""The 28 nodes of a robot, played by python-can and cantools: nothing of the runtime's or firmware's own C code."""

from __future__ import annotations

import threading
import time
from collections import defaultdict

import can
from crux_contracts import can_codec
from crux_contracts.robot import load_robot

LIMBS = 4
JOINTS = range(1, 7)
SLOTS = 7  # of a limb in messages
GRIPPER = 7
SYNC = 0x10
COMMANDS = (*range(0x101, 0x108), 0x20)
HOLD_STATE = 1


def joint_position_rad(cycle: int, limb: int, node: int) -> float:
    """What a joint says in a cycle: another number in every cycle and joint, exact as float32."""
    return limb + node / 8 + (cycle % 1024) / 1024


def finger_force_N(cycle: int, limb: int) -> float:
    """What a gripper says in a cycle, in steps of its signal."""
    return limb + (cycle % 100) / 100


class FakeNodes:
    """Answers every Sync up to `last_cycle`, then falls silent. Runs in a thread of its own."""

    def __init__(
        self,
        bus_urls: list[str],
        last_cycle: int,
        deaf: tuple[int, int] | None = None,
        mute: bool = False,
        hash_: int | None = None,
    ) -> None:
        """`deaf`: (limb, node) of a node that answers nothing from cycle 1 on; `mute`: they started long ago, and say
        who they are when they are asked only; `hash_` of a foreign robot description."""
        self.mute = mute
        self.late_s = 0.0
        """how long they think about every answer, as on a busy machine"""
        self.hash = int(load_robot("scaler").hash[:8], 16) if hash_ is None else hash_
        self.limb_of = list(range(LIMBS))
        self.last_cycle = last_cycle
        self.deaf = deaf
        self.answered = -1
        self.done = threading.Event()
        self.commands: dict[tuple[int, int], list[can_codec.Decoded]] = defaultdict(list)
        """of (limb, identifier), all that were received, in order"""
        self.bad_commands = 0
        self._buses = []
        for url in bus_urls:
            _, group, port = url.split(":")
            self._buses.append(can.Bus(interface="udp_multicast", channel=group, port=int(port), hop_limit=0, fd=True))
        self._counters: dict[tuple[int, int], int] = defaultdict(int)
        self._receivers: dict[tuple[int, int], can_codec.Receiver] = defaultdict(can_codec.Receiver)
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._serve, args=(limb,)) for limb in range(LIMBS)]

    def __enter__(self) -> FakeNodes:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for bus in self._buses:
            bus.shutdown()

    def await_cycle(self, cycle: int, timeout_s: float = 600.0) -> None:
        """Waits until a limb has answered `cycle`."""
        end = time.monotonic() + timeout_s
        while self.answered < cycle:
            assert time.monotonic() < end, f"no Sync({cycle}) within {timeout_s} s"
            time.sleep(0.005)

    def _send(self, limb: int, name: str, node: int, values: can_codec.Values, line: int = 0) -> None:
        if (limb, node) == self.deaf and values.get("CycleEcho", 1) != 0:
            return
        key = (limb, line + (node if name != "ForceTorque" else 8))
        frame = can_codec.encode(name, values, self._counters[key], node if name.startswith("Joint") else None)
        self._counters[key] += 1
        self._buses[limb].send(
            can.Message(
                arbitration_id=frame.identifier,
                is_extended_id=False,
                data=frame.data,
                is_fd=True,
                bitrate_switch=True,
            )
        )

    def _introduce(self, limb: int, node: int) -> None:
        version = int(can_codec.database().dbc.attributes["ProtocolVersion"].value)  # type: ignore[union-attr]
        who: dict[str, float | int] = {
            "Protocol": version,
            "NodeId": node,
            "Limb": self.limb_of[limb],
            "ParameterHash": self.hash,
        }
        self._send(limb, "GripperIdentity" if node == GRIPPER else "JointIdentity", node, who, 16)

    def _answer(self, limb: int, cycle: int) -> None:
        echo = cycle & 0xFFFF
        for node in JOINTS:
            position = joint_position_rad(cycle, limb, node)
            values = {"State": HOLD_STATE, "Position_rad": position, "Velocity_rad_s": -0.5, "CycleEcho": echo}
            self._send(limb, "JointStatus", node, values)
        force = finger_force_N(cycle, limb)
        self._send(limb, "GripperStatus", GRIPPER, {"State": HOLD_STATE, "Force_N": force, "CycleEcho": echo})
        self._send(limb, "ForceTorque", GRIPPER, {"ForceX_N": 1.25, "MomentZ_Nm": -0.5, "CycleEcho": echo})

    def _serve(self, limb: int) -> None:
        for node in () if self.mute else (*JOINTS, GRIPPER):
            self._introduce(limb, node)
        while not self._stop.is_set():
            message = self._buses[limb].recv(0.05)
            if message is None or (message.arbitration_id != SYNC and message.arbitration_id not in COMMANDS):
                continue
            frame = can_codec.Frame(message.arbitration_id, bytes(message.data))
            verdict = can_codec.check(frame, self._receivers[limb, message.arbitration_id])
            if verdict is not can_codec.Verdict.OK:
                self.bad_commands += 1
                continue
            decoded = can_codec.decode(frame)
            if message.arbitration_id != SYNC:
                self.commands[limb, message.arbitration_id].append(decoded)
                if decoded.values.get("Identify"):
                    self._introduce(limb, int(decoded.values["Identify"]))
                continue
            cycle = int(decoded.values["Cycle"])
            if cycle > self.last_cycle:
                self.done.set()
                continue
            time.sleep(self.late_s)
            self._answer(limb, cycle)
            self.answered = max(self.answered, cycle)
