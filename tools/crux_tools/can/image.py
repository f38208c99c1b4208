"""Signed images of node firmware (firmware/update/image.h): keys, signing, reading."""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts import can_codec

from crux_tools.errors import UsageError
from crux_tools.signing_key import read_key

MAGIC = b"CRUXIMG1"
SIGNED_BYTES = 128
HEADER_BYTES = 192
ELF_MAGIC = b"\x7fELF"
LARGEST_VERSION = 99


def node_kinds() -> dict[str, int]:
    """joint and gripper, as Identity.NodeKind numbers them."""
    choices: dict[int, Any] = can_codec.message("JointIdentity", 1).get_signal_by_name("NodeKind").choices or {}
    return {str(name).lower(): int(value) for value, name in choices.items()}


def version_number(text: str) -> int:
    """1.2.3 as CRUX_FIRMWARE_VERSION has it: two digits a part. Raises UsageError."""
    match = re.fullmatch(r"(\d+)\.(\d+)\.(\d+)", text)
    parts = [int(part) for part in match.groups()] if match else []
    if not match or max(parts) > LARGEST_VERSION:
        raise UsageError(f"version {text}: right is MAJOR.MINOR.PATCH, each 0 .. {LARGEST_VERSION}")
    return int("".join(f"{part:02d}" for part in parts), 16)


def version_text(number: int) -> str:
    """The other way round."""
    return ".".join(str(int(f"{number >> shift & 0xFF:02x}")) for shift in (16, 8, 0))


@dataclass(frozen=True)
class Program:
    """The bytes of a program, and the address it is linked for (0: none)."""

    payload: bytes
    address: int


@dataclass(frozen=True)
class Image:
    """A signed image, as read; the node judges the signature."""

    header: bytes
    payload: bytes
    kind: str
    version: int
    address: int


def read_program(path: Path) -> Program:
    """A program: an ELF file of the linker, or bytes that run anywhere. Raises UsageError for an ELF without them."""
    data = path.read_bytes()
    if not data:
        raise UsageError(f"{path}: is empty")
    if data[:4] != ELF_MAGIC:
        return Program(data, 0)
    try:
        (table,) = struct.unpack_from("<I", data, 28)
        size, count = struct.unpack_from("<2H", data, 42)
        segments = [struct.unpack_from("<5I", data, table + i * size) for i in range(count)]
    except struct.error:
        raise UsageError(f"{path}: an ELF file that is cut short") from None
    # (type, offset, virtual address, load address, bytes in the file)
    loaded = sorted((load, data[at : at + length]) for kind, at, _, load, length in segments if kind == 1 and length)
    if data[4:6] != b"\1\1" or not loaded:
        raise UsageError(f"{path}: an ELF file without a program for a 32-bit processor")
    start = loaded[0][0]
    payload = bytearray()
    for address, content in loaded:
        payload = payload.ljust(address - start, b"\xff")
        payload[address - start : address - start + len(content)] = content
    return Program(bytes(payload), start)


def sign(payload: bytes, kind: str, version: int, key_file: Path, address: int = 0) -> tuple[bytes, bytes]:
    """The image of a program linked for an address (0: for none), and the public half of the key.

    Raises UsageError for a file that holds no Ed25519 key.
    """
    key = read_key(key_file)
    head = MAGIC + struct.pack("<4I", node_kinds()[kind], version, len(payload), address) + bytes(40)
    head += hashlib.sha512(payload).digest()
    return head + key.sign(head) + payload, key.public_key().public_bytes_raw()


def read_images(path: Path) -> list[Image]:
    """The signed images of a file, one after another. Raises UsageError when one is none, or damaged."""
    data = path.read_bytes()
    names = {number: name for name, number in node_kinds().items()}
    images: list[Image] = []
    while data or not images:
        if len(data) < HEADER_BYTES or data[: len(MAGIC)] != MAGIC:
            raise UsageError(f"{path}: not a signed image; `crux can sign` makes one")
        kind, version, length, address = struct.unpack("<4I", data[8:24])
        header, payload = data[:HEADER_BYTES], data[HEADER_BYTES : HEADER_BYTES + length]
        if len(payload) != length or hashlib.sha512(payload).digest() != header[64:SIGNED_BYTES]:
            raise UsageError(f"{path}: damaged: {len(payload)} bytes where {length} with another digest were signed")
        images.append(Image(header, payload, names.get(kind, f"kind {kind}"), version, address))
        data = data[HEADER_BYTES + length :]
    return images
