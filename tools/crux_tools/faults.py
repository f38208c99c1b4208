"""Words for the numbered faults of msgs/faults.yaml."""

from __future__ import annotations

from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_msgs.tables import FAULTS


def fault_text(fault: Any, robot: Robot) -> str:
    """One line for a fault message: what, where, the value and its limit."""
    known = {code: (name, text) for code, name, _to, text in FAULTS}
    code = int(fault["code"])
    name, text = known.get(code, (f"fault {code}", "value (limit: limit)"))
    words = text.replace("limit: limit", "limit: @").replace("value", f"{float(fault['value']):.4g}")
    words = words.replace("@", f"{float(fault['limit']):.4g}")
    limb = int(fault["limb"])
    where = f" {LIMB_NAMES[limb]}" if 0 <= limb < len(LIMB_NAMES) else ""
    nodes = {number: node for node, number in robot.can.nodes.items()}
    node = f" {nodes[int(fault['node'])]}" if int(fault["node"]) in nodes else ""
    return f"{name}{where}{node} in cycle {int(fault['cycle'])}: {words}"
