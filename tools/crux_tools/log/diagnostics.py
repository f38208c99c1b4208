"""The nodes and 4 buses of a log as ROS diagnostics: a status each, with its numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES, can_codec
from crux_msgs import bus_health_t
from crux_msgs.tables import MEMBERS

from crux_tools.log.ros2 import encoded, stamp
from crux_tools.log.seen import NS, Seen

OK, WARN, ERROR, STALE = range(4)  # of diagnostic_msgs/DiagnosticStatus
BUS_WORDS = {getattr(bus_health_t, name): name for name in dir(bus_health_t) if name.isupper()}
COUNTED = [name for name, *_ in MEMBERS["bus_health_t"] if name not in {"cycle", "limb", "state"}]


def _choices(message: str, signal: str) -> dict[int, str]:
    found: dict[Any, Any] = can_codec.message(message, 1).get_signal_by_name(signal).choices or {}
    return {int(value): str(name) for value, name in found.items()}


def _fault_words(faults: int, causes: dict[int, str]) -> str:
    """Bit n is cause n + 1; causes 2 and 3 have no bit, theirs are those of 11 and 12 (msgs/can/README.md)."""
    numbers = [{2: 11, 3: 12}.get(bit + 1, bit + 1) for bit in range(8) if faults >> bit & 1]
    return ", ".join(causes.get(number, f"#{number}") for number in numbers)


def _nodes(inputs: Any, states: dict[int, str], causes: dict[int, str]) -> Iterator[dict[str, Any]]:
    """A status a node, of one row of control_input."""
    for limb, limb_name in enumerate(LIMB_NAMES):
        slots = len(inputs["joint_state"]) // len(LIMB_NAMES)
        for joint in range(slots + 1):
            gripper = joint == slots
            kind, at = ("gripper", limb) if gripper else ("joint", limb * slots + joint)
            name = f"{limb_name}.{'gripper' if gripper else f'joint{joint + 1}'}"
            state = states.get(int(inputs[f"{kind}_state"][at]), f"#{inputs[f'{kind}_state'][at]}")
            faults = _fault_words(int(inputs[f"{kind}_faults"][at]), causes)
            fresh = bool(inputs[f"{kind}_fresh"][at])
            level = STALE if not fresh else ERROR if state == "FAULT" else WARN if faults else OK
            yield {
                "level": level,
                "name": f"nodes/{name}",
                "message": state + (f": {faults}" if faults else "") + ("" if fresh else " (silent in this cycle)"),
                "hardware_id": name,
            }


def _bus(health: Any) -> dict[str, Any]:
    limb, state = LIMB_NAMES[int(health["limb"])], int(health["state"])
    level = OK if state == bus_health_t.ACTIVE else ERROR if state >= bus_health_t.OFF else WARN
    known = health.dtype.names or ()
    return {
        "level": level,
        "name": f"buses/{limb}",
        "message": BUS_WORDS.get(state, f"#{state}"),
        "hardware_id": limb,
        "values": [{"key": name, "value": str(int(health[name]))} for name in COUNTED if name in known],
    }


def diagnostics(seen: Seen) -> Iterator[tuple[int, str, bytes]]:
    """Times, topic and DiagnosticArrays: once a second, and when a node or bus has changed, at the rate of `seen`."""
    states, causes = _choices("JointStatus", "State"), _choices("JointEmergency", "Cause")
    log = seen.log
    parts = [log.inputs[f"{kind}_{what}"] for kind in ("joint", "gripper") for what in ("fresh", "state", "faults")]
    key = np.concatenate([part.astype(np.int64) for part in parts], axis=1)
    changed = np.flatnonzero((key[1:] != key[:-1]).any(axis=1)) + 1
    if len(changed):  # the first between two rows
        changed = changed[np.unique(np.searchsorted(seen.rows, changed, "right"), return_index=True)[1]]
    every = seen.rows[np.unique((seen.times_ns - seen.times_ns[0]) // NS, return_index=True)[1]]
    limbs = range(len(LIMB_NAMES))
    newest = [log.buses[log.buses["limb"] == limb] if len(log.buses) else log.buses for limb in limbs]
    for row in np.union1d(every, changed):
        status = list(_nodes(log.inputs[row], states, causes))
        for table in newest:
            at = int(np.searchsorted(table["cycle"], log.state["cycle"][row], "right")) - 1 if len(table) else -1
            status += [_bus(table[at])] if at >= 0 else []
        time_ns = int(seen.clock(np.round(log.time_s[row : row + 1] * NS).astype(np.int64))[0])
        message = {"header": {"stamp": stamp(time_ns)}, "status": status}
        yield time_ns, "/diagnostics", encoded("diagnostic_msgs/DiagnosticArray", message)
