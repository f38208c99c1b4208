"""Writes node_table.c and bit_rates.h, the parameters of all nodes of a robot, for the microcontroller images; and
built_for.json, which says what robot they are for."""

from __future__ import annotations

import argparse
import ctypes
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import crux_nodes
import drive_parameters
from crux_contracts.robot import Robot, load_robot
from crux_contracts.yaml_document import DocumentError


def _number(value: float | int) -> str:
    return f"{value:.9g}F" if isinstance(value, float) and not value.is_integer() else f"{value:.1f}F"


def _value(value: float | int | ctypes.Structure) -> str:
    if isinstance(value, ctypes.Structure):
        members = (f".{field[0]} = {_value(getattr(value, field[0]))}" for field in value._fields_)
        return "{" + ", ".join(members) + "}"
    return f"{value}U" if isinstance(value, int) else _number(value)


def _table(kind: str, name: str, count: str, entries: Sequence[ctypes.Structure]) -> str:
    lines = "".join(f"    {_value(entry)},\n" for entry in entries)
    return f"const crux_{kind}_parameters node_table_{name}[{count}] = {{\n{lines}}};\n\n"


def node_table(robot: Robot) -> str:
    """C source of the parameter tables."""
    joints, limbs = "CRUX_CAN_LIMBS * CRUX_CAN_JOINTS", "CRUX_CAN_LIMBS"
    return (
        f"// Generated from the robot description {robot.name}. Do not edit.\n"
        '#include "node_table.h"\n\n'
        + _table("joint", "joints", joints, crux_nodes.joint_parameters(robot))
        + _table("gripper", "grippers", limbs, crux_nodes.gripper_parameters(robot))
        + _table("joint_drive", "joint_drives", joints, drive_parameters.joint_drive_parameters(robot))
        + _table("gripper_drive", "gripper_drives", limbs, drive_parameters.gripper_drive_parameters(robot))
        + f"const uint32_t node_table_hash = 0x{crux_nodes.parameter_hash(robot):08X}U;\n"
    )


def bit_rates(robot: Robot) -> str:
    """C header of the bus's bit rates."""
    return (
        f"// Generated from the robot description {robot.name}. Do not edit.\n"
        "#ifndef CRUX_STM32G474_BIT_RATES_H\n#define CRUX_STM32G474_BIT_RATES_H\n\n"
        f"#define NODE_BIT_RATE {robot.can.bit_rate}UL\n"
        f"#define NODE_DATA_BIT_RATE {robot.can.data_bit_rate}UL\n\n#endif\n"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", required=True, help="name or folder of a robot description")
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    options = parser.parse_args()
    try:
        robot = load_robot(options.robot)
    except DocumentError as error:
        print(f"generate_node_table: {error}", file=sys.stderr)
        return 2
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "node_table.c").write_text(node_table(robot), encoding="utf-8")
    (options.out / "bit_rates.h").write_text(bit_rates(robot), encoding="utf-8")
    built_for = {"robot": robot.name, "parameter_hash": crux_nodes.parameter_hash(robot)}
    (options.out / "built_for.json").write_text(json.dumps(built_for) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
