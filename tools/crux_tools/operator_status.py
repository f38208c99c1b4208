"""What a runtime says of its fault and its nodes, in words and as JSON."""

from __future__ import annotations

import time
from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.channels import FAULT_BY_CODE
from crux_msgs import acknowledgement_t, status_t
from crux_msgs.tables import FAULT_HELP

NODES_PER_LIMB = 7
NODE_WORDS = {
    status_t.SILENT: ("silent", "look at power and cables"),
    status_t.UNIDENTIFIED: (
        "not identified yet",
        "asked for its identity; firmware without this protocol never answers",
    ),
    status_t.WRONG_PROTOCOL: ("other CAN protocol", "update its firmware"),
    status_t.WRONG_PLACE: ("in another limb's place", "cables of two limbs are swapped"),
    status_t.WRONG_ROBOT: ("made for another robot description", "update its firmware, or start with its --robot"),
}


def fault_of(status: status_t | None) -> dict[str, Any] | None:
    """The fault that stands: code, name, where, text, since when, cause and what to do; None where there is none."""
    if status is None or status.fault.code == 0:
        return None
    fault = status.fault
    kind = FAULT_BY_CODE.get(fault.code)
    limb = LIMB_NAMES[fault.limb] if fault.limb >= 0 else None
    where = "" if limb is None else f"{limb} node {fault.node}: " if fault.node else f"{limb}: "
    cause, remedy = FAULT_HELP.get(
        fault.code, ("the runtime is newer than this command", "use the crux of its version")
    )
    return {
        "code": fault.code,
        "name": kind.name if kind else "unknown",
        "limb": limb,
        "node": fault.node or None,
        "where": where,
        "text": kind.describe(fault.value, fault.limit) if kind else "a fault this version does not know",
        "age_s": status.fault_age_s,
        "since": time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(time.time() - status.fault_age_s)),
        "cause": cause,
        "do": remedy,
    }


def _nodes(status: status_t) -> dict[int, list[str]]:
    """Names of the nodes that are not well, by what is wrong with them."""
    wrong: dict[int, list[str]] = {}
    for index, state in enumerate(status.node_state):
        if state != status_t.WELL:
            wrong.setdefault(state, []).append(f"{LIMB_NAMES[index // NODES_PER_LIMB]}.{index % NODES_PER_LIMB + 1}")
    return wrong


def status_json(answer: acknowledgement_t, status: status_t | None) -> dict[str, Any]:
    """What `crux status --json` prints."""
    from crux_tools.operator_link import STATES

    return {
        "ok": True,
        "state": STATES.get(answer.supervisor_state, str(answer.supervisor_state)),
        "plan_id": answer.plan_id,
        "fault": fault_of(status),
        "nodes": None if status is None else {NODE_WORDS[state][0]: names for state, names in _nodes(status).items()},
    }


def status_lines(status: status_t | None) -> list[str]:
    """What `crux status` prints below the state."""
    if status is None:
        return ["it tells nothing of its nodes and faults: of an older crux, or its message was lost"]
    lines = []
    if (fault := fault_of(status)) is not None:
        lines.append(f"fault {fault['code']} {fault['name']}: {fault['where']}{fault['text']}")
        lines.append(f"  since {fault['since']}, {fault['age_s']:.0f} s ago")
        lines.append(f"  cause: {fault['cause']}")
        lines.append(f"  do: {fault['do']}")
    for state, names in _nodes(status).items():
        word, remedy = NODE_WORDS[state]
        which = "all" if len(names) == len(LIMB_NAMES) * NODES_PER_LIMB else ", ".join(names)
        lines.append(f"{len(names)} nodes {word} ({which}): {remedy}")
    return lines
