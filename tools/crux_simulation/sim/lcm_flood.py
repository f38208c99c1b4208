"""Floods a runtime's LCM address until it is ended: `python -m crux_simulation.sim.lcm_flood URL`.

By turns requests for the status, each of which is to be answered, START of a plan that is not loaded, which the control
cycle has to log, first pieces of plans that never come to their end, and bytes that mean nothing; as many as one core
sends, with a pause after each burst.
"""

from __future__ import annotations

import sys
import time
from itertools import count

from crux_contracts import channels
from crux_msgs import command_t, plan_piece_t
from crux_tools.lcm_socket import LcmSocket

BURST, PAUSE_S = 100, 0.001
FIRST_REQUEST = 1 << 40  # nobody else's
PIECES = 500
NO_PLAN = "0" * 64


def _command(number: int, command: int) -> bytes:
    message = command_t()
    message.request_id, message.command, message.plan_id = FIRST_REQUEST + number, command, NO_PLAN
    return bytes(message.encode())


def _first_piece(number: int) -> bytes:
    piece = plan_piece_t()
    piece.transfer_id, piece.plan_id = FIRST_REQUEST + number, NO_PLAN
    piece.n_pieces, piece.total_bytes = PIECES, PIECES * plan_piece_t.MAX_BYTES
    piece.n_bytes, piece.data = plan_piece_t.MAX_BYTES, bytes(plan_piece_t.MAX_BYTES)
    return bytes(piece.encode())


def main() -> None:
    """Never returns."""
    link = LcmSocket(sys.argv[1])
    for number in count():
        link.publish(channels.CRUX_COMMAND, _command(2 * number, command_t.STATUS))
        link.publish(channels.CRUX_COMMAND, _command(2 * number + 1, command_t.START))
        link.publish(channels.CRUX_PLAN_PIECE, _first_piece(number))
        link.publish(channels.CRUX_COMMAND, number.to_bytes(64))
        if number % BURST == BURST - 1:
            time.sleep(PAUSE_S)


if __name__ == "__main__":
    main()
