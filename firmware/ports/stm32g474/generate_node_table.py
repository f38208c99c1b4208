"""Writes node_table.c and bit_rates.h: the parameters of all nodes of a robot, for the microcontroller images."""

from __future__ import annotations

import argparse
import ctypes
import sys
from pathlib import Path

import crux_nodes
from crux_contracts.robot import Robot, load_robot
from crux_contracts.yaml_document import DocumentError


def _number(value: float | int) -> str:
    return f"{value:.9g}F" if isinstance(value, float) and not value.is_integer() else f"{value:.1f}F"


def _initialiser(parameters: ctypes.Structure) -> str:
    members = []
    for field in parameters._fields_:
        value = getattr(parameters, field[0])
        members.append(f".{field[0]} = {f'{value}U' if isinstance(value, int) else _number(value)}")
    return "    {" + ", ".join(members) + "},\n"


def node_table(robot: Robot) -> str:
    """C source of the parameter tables."""
    joints = "".join(_initialiser(joint) for joint in crux_nodes.joint_parameters(robot))
    grippers = "".join(_initialiser(gripper) for gripper in crux_nodes.gripper_parameters(robot))
    return (
        f"// Generated from the robot description {robot.name}. Do not edit.\n"
        '#include "node_table.h"\n\n'
        f"const crux_joint_parameters node_table_joints[NODE_TABLE_LIMBS * CRUX_CAN_JOINTS] = {{\n{joints}}};\n\n"
        f"const crux_gripper_parameters node_table_grippers[NODE_TABLE_LIMBS] = {{\n{grippers}}};\n\n"
        f"const uint32_t node_table_hash = 0x{crux_nodes.parameter_hash(robot):08X}U;\n"
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
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
