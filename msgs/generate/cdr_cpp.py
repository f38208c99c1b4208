"""C++ codec of every message as little-endian CDR (XCDR1, as ROS 2 writes it), and a careful decoder of LCM."""

from __future__ import annotations

from .lcm_types import Field, Struct

_HEADER = """// Generated from msgs/lcm by msgs/generate. Do not edit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

{includes}

namespace crux_msgs {{

// encode_cdr writes the message with its four-byte encapsulation header into `out` and gives the number of bytes
// written, 0 when `out` is too small. It neither allocates nor throws.
// cdr_size gives the number of bytes encode_cdr needs.
// decode_cdr reads it back; false when the bytes are no little-endian CDR, too short, too long, or a length field
// disagrees with its sequence. It allocates for strings and sequences only, never more than the bytes can hold.
// decode_lcm reads an LCM message from bytes that may be hostile, under the same promises; lcm-gen's own decode()
// believes every length it finds.
{declarations}

}}  // namespace crux_msgs
"""

_SOURCE = """// Generated from msgs/lcm by msgs/generate. Do not edit.
#include "crux_msgs/cdr.hpp"

#include "cdr_stream.hpp"

namespace crux_msgs {{
namespace cdr {{

{bodies}

}}  // namespace cdr

{functions}

}}  // namespace crux_msgs
"""


def _visit_line(member: Field) -> str:
    name = f"m.{member.name}"
    if isinstance(member.dimension, str):
        return f"  s.sequence({name}, m.{member.dimension});"
    if isinstance(member.dimension, int):
        return f"  s.array({name});"
    return f"  s.value({name});"


def _body(struct: Struct) -> str:
    lines = "\n".join(_visit_line(member) for member in struct.fields)
    return (
        f"template <class S, class Message>\n"
        f"  requires Is<Message, {struct.name}>\n"
        f"void visit(S& s, Message& m) {{\n{lines}\n}}"
    )


def header(structs: dict[str, Struct]) -> str:
    names = list(structs)
    declarations = "\n".join(
        f"std::size_t encode_cdr(const {n}& message, std::span<std::uint8_t> out) noexcept;\n"
        f"std::size_t cdr_size(const {n}& message) noexcept;\n"
        f"bool decode_cdr(std::span<const std::uint8_t> bytes, {n}& message);\n"
        f"bool decode_lcm(std::span<const std::uint8_t> bytes, {n}& message);"
        for n in names
    )
    includes = "\n".join(f'#include "crux_msgs/{n}.hpp"' for n in sorted(names))
    return _HEADER.format(includes=includes, declarations=declarations)


def source(structs: dict[str, Struct]) -> str:
    bodies = "\n\n".join(_body(struct) for struct in structs.values())
    functions = "\n".join(
        f"std::size_t encode_cdr(const {n}& message, std::span<std::uint8_t> out) noexcept {{\n"
        f"  cdr::Writer s(out);\n  visit(s, message);\n  return s.finish();\n}}\n"
        f"std::size_t cdr_size(const {n}& message) noexcept {{\n"
        f"  cdr::Sizer s;\n  visit(s, message);\n  return s.finish();\n}}\n"
        f"bool decode_cdr(std::span<const std::uint8_t> bytes, {n}& message) {{\n"
        f"  cdr::Reader s(bytes);\n  visit(s, message);\n  return s.finish();\n}}\n"
        f"bool decode_lcm(std::span<const std::uint8_t> bytes, {n}& message) {{\n"
        f"  cdr::LcmReader s(bytes, {n}::getHash());\n  visit(s, message);\n  return s.finish();\n}}\n"
        for n in structs
    )
    return _SOURCE.format(bodies=bodies, functions=functions)
