"""The nodes' parameters in C: a struct for each kind of node, and the table that tells of its members."""

from __future__ import annotations

from crux_contracts.node_parameters import NODE_KINDS, Parameter

_C_TYPES = {"float": "float", "integer": "uint32_t"}


def _struct(kind: str, parameters: tuple[Parameter, ...]) -> str:
    members = "".join(f"  {_C_TYPES[p.kind]} {p.name};  ///< {p.means}\n" for p in parameters)
    return f"typedef struct crux_{kind}_parameters {{\n{members}}} crux_{kind}_parameters;\n"


def header(table: dict[str, tuple[Parameter, ...]]) -> str:
    """crux_parameters.h."""
    structs = "\n".join(_struct(kind, table[kind]) for kind in NODE_KINDS)
    counts = "\n".join(f"#define CRUX_{kind.upper()}_PARAMETERS {len(table[kind])}U" for kind in NODE_KINDS)
    tables = "\n".join(
        f"extern const crux_parameter crux_{kind}_parameter_table[CRUX_{kind.upper()}_PARAMETERS];"
        for kind in NODE_KINDS
    )
    return f"""// Generated from msgs/can/parameters.yaml by msgs/generate. Do not edit.
#ifndef CRUX_PARAMETERS_H
#define CRUX_PARAMETERS_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

{structs}
{counts}
#define CRUX_MOST_PARAMETERS {max(len(table[kind]) for kind in NODE_KINDS)}U

/// A member of a parameter struct; all have four bytes, and the table is in the struct's order.
typedef struct crux_parameter {{
  const char *name;
  const char *unit;
  uint8_t id;
  bool is_integer;
  bool writable;
  bool acts_now;  ///< else from the next start
  float least_share;  ///< of the robot description's value
  float greatest_share;
}} crux_parameter;

{tables}

#ifdef __cplusplus
}}
#endif

#endif
"""


def _row(parameter: Parameter) -> str:
    low, high = parameter.write or (1.0, 1.0)
    flags = (parameter.kind == "integer", parameter.write is not None, parameter.acts == "now")
    words = ", ".join("true" if flag else "false" for flag in flags)
    return f'    {{"{parameter.name}", "{parameter.unit}", {parameter.id}U, {words}, {low:.6f}F, {high:.6f}F}},\n'


def source(table: dict[str, tuple[Parameter, ...]]) -> str:
    """crux_parameters.c."""
    tables = "\n".join(
        f"const crux_parameter crux_{kind}_parameter_table[CRUX_{kind.upper()}_PARAMETERS] = {{\n"
        + "".join(_row(parameter) for parameter in table[kind])
        + "};\n"
        for kind in NODE_KINDS
    )
    checks = "\n".join(
        f'_Static_assert(sizeof(crux_{kind}_parameters) == 4U * CRUX_{kind.upper()}_PARAMETERS, "four bytes a member");'
        for kind in NODE_KINDS
    )
    return (
        "// Generated from msgs/can/parameters.yaml by msgs/generate. Do not edit.\n"
        f'#include "crux_parameters.h"\n\n{checks}\n\n{tables}'
    )
