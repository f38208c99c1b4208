"""The numbers of the nodes' services in C."""

from __future__ import annotations

from crux_contracts.node_services import GROUPS


def header(numbers: dict[str, dict[str, int]]) -> str:
    """crux_services.h."""
    enums = ""
    for group in GROUPS:
        lines = "".join(f"  CRUX_{group.upper()}_{name} = 0x{number:02X},\n" for name, number in numbers[group].items())
        enums += f"enum {{\n{lines}}};\n"
    return (
        "// Generated from msgs/can/services.yaml by msgs/generate. Do not edit.\n"
        f"#ifndef CRUX_SERVICES_H\n#define CRUX_SERVICES_H\n\n{enums}\n#endif\n"
    )
