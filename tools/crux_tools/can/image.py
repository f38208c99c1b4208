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

MAGIC = b"CRUXIMG1"
SIGNED_BYTES = 128
HEADER_BYTES = 192
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
class Image:
    """A signed image, as read; the node judges the signature."""

    header: bytes
    payload: bytes
    kind: str
    version: int


def new_key(path: Path) -> bytes:
    """Writes a new private key (PEM, for its owner alone); returns the public half. Raises OSError."""
    import os

    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    key = Ed25519PrivateKey.generate()
    text = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(text)
    return key.public_key().public_bytes_raw()


def sign(payload: bytes, kind: str, version: int, key_file: Path, address: int = 0) -> tuple[bytes, bytes]:
    """The image of a program linked for an address (0: for none), and the public half of the key.

    Raises UsageError for a file that holds no Ed25519 key.
    """
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives import serialization
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    try:
        key = serialization.load_pem_private_key(key_file.read_bytes(), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise UsageError(f"{key_file}: no private key in PEM without a password ({error})") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise UsageError(f"{key_file}: not an Ed25519 key")
    head = MAGIC + struct.pack("<4I", node_kinds()[kind], version, len(payload), address) + bytes(40)
    head += hashlib.sha512(payload).digest()
    return head + key.sign(head) + payload, key.public_key().public_bytes_raw()


def read_image(path: Path) -> Image:
    """A signed image. Raises UsageError when the file is none, or damaged."""
    data = path.read_bytes()
    if len(data) < HEADER_BYTES or data[: len(MAGIC)] != MAGIC:
        raise UsageError(f"{path}: not a signed image; `crux can sign` makes one")
    kind, version, length = struct.unpack("<3I", data[8:20])
    payload = data[HEADER_BYTES:]
    if len(payload) != length or hashlib.sha512(payload).digest() != data[64:SIGNED_BYTES]:
        raise UsageError(f"{path}: damaged: {len(payload)} bytes where {length} with another digest were signed")
    names = {number: name for name, number in node_kinds().items()}
    return Image(data[:HEADER_BYTES], payload, names.get(kind, f"kind {kind}"), version)
