"""Runs inside a kernel with SocketCAN: nodes on can0 .. can3, asked through the kernel's own ISO-TP sockets."""

from __future__ import annotations

import json
import socket
import struct
import sys
import threading
from collections.abc import Sequence

import crux_nodes
import numpy as np
from crux_contracts.node_parameters import table
from crux_contracts.node_services import number
from crux_contracts.robot import load_robot
from crux_tools.paths import built

SOL_CAN_ISOTP, CAN_ISOTP_LL_OPTS = 106, 5
CANFD_MTU, CANFD_BRS, FRAME_BYTES = 72, 1, 64
PERIOD_S = 0.001


def ask(interface: str, node: int, requests: Sequence[bytes]) -> list[str]:
    """Answers in hex."""
    with socket.socket(socket.AF_CAN, socket.SOCK_DGRAM, socket.CAN_ISOTP) as bus:
        bus.setsockopt(SOL_CAN_ISOTP, CAN_ISOTP_LL_OPTS, struct.pack("=3B", CANFD_MTU, FRAME_BYTES, CANFD_BRS))
        bus.bind((interface, 0x580 + node, 0x600 + node))
        bus.settimeout(5.0)
        answers = []
        for request in requests:
            bus.send(request)
            answers.append(bus.recv(4096).hex())
        return answers


def main() -> int:
    robot = load_robot("scaler")
    joints, grippers = crux_nodes.joint_parameters(robot), crux_nodes.gripper_parameters(robot)
    urls = [f"socketcan:can{limb}" for limb in range(crux_nodes.LIMBS)]
    still, open_, none = np.zeros(28), np.full(4, 0.03), np.zeros(4)
    over = threading.Event()
    with crux_nodes.Nodes(built("firmware/libcrux_nodes.so"), urls, joints, grippers) as nodes:

        def live() -> None:
            while not over.is_set():
                nodes.wait_sync(PERIOD_S)
                nodes.control(PERIOD_S, still, still, open_, none, none)
                nodes.publish(still, still, still, open_, none, none, np.zeros(24))

        life = threading.Thread(target=live)
        life.start()
        try:
            descriptions = [
                struct.pack(">BH", number("service", "READ"), number("data", "DESCRIPTION") + parameter.id)
                for parameter in table()["joint"]
            ]
            answers = {
                "descriptions": ask("can2", 4, descriptions),
                "long": ask(
                    "can0", 7, [bytes([number("service", "WRITE")]) + bytes(n) for n in (3, 61, 62, 500, 1023)]
                ),
            }
        finally:
            over.set()
            life.join()
    print(json.dumps(answers))
    return 0


if __name__ == "__main__":
    sys.exit(main())
