"""Unpacks the chunks of an MCAP file within bounds, believing neither a chunk's header nor its compressed frame."""

from __future__ import annotations

import zlib

import lz4.frame
import zstandard
from mcap.records import Chunk

MB = 1_000_000
CHUNK_BYTES = 64 * MB  # of one chunk: crux's have 1 MB, but for one with a plan, which is at most 32 MB
RATIO = 10  # of a file's unpacked bytes to those it has; 2 to 3 in logs of crux
ALWAYS_BYTES = 64 * MB  # of a small file
_WINDOW_BYTES = 1 << 26  # the least power of two above CHUNK_BYTES


class Unpacker:
    """Of one file of `file_bytes`. What is left out stands in `notes`."""

    def __init__(self, file_bytes: int) -> None:
        self.limit_bytes = ALWAYS_BYTES + RATIO * file_bytes
        self._left_bytes = self.limit_bytes
        self.damaged = 0
        self._too_large: list[tuple[int, int]] = []  # byte of the file, bytes that the chunk claims
        self._too_much: list[tuple[int, int]] = []

    @property
    def left_out(self) -> int:
        """Chunks that are not whole, or too large."""
        return self.damaged + len(self._too_large) + len(self._too_much)

    def content(self, chunk: Chunk, at: int) -> bytes:
        """The records of a chunk at a byte of the file; nothing of a damaged one, or of one that is too large."""
        claimed = chunk.uncompressed_size if chunk.compression else len(chunk.data)
        if claimed > CHUNK_BYTES:
            self._too_large.append((at, claimed))
        elif claimed > self._left_bytes:
            self._too_much.append((at, claimed))
        else:
            self._left_bytes -= claimed
            data = _unpacked(chunk, claimed)
            if data is not None and (not chunk.uncompressed_crc or zlib.crc32(data) == chunk.uncompressed_crc):
                return data
            self.damaged += 1
        return b""

    def notes(self) -> list[str]:
        """A sentence for each reason why chunks were left out."""
        said = []
        if self.damaged:
            said.append(
                "a damaged chunk is left out" if self.damaged == 1 else f"{self.damaged} damaged chunks are left out"
            )
        if self._too_large:
            said.append(f"{_left_out(self._too_large)}: no more than {CHUNK_BYTES // MB} MB of one are unpacked")
        if self._too_much:
            limit_mb = self.limit_bytes // MB
            said.append(f"{_left_out(self._too_much)}: of a file of this size no more than {limit_mb} MB are unpacked")
        return said


def _left_out(chunks: list[tuple[int, int]]) -> str:
    at, claimed = chunks[0]
    claim = f"at byte {at}, which claims to hold {claimed / MB:.1f} MB,"
    return (
        f"the chunk {claim} is left out"
        if len(chunks) == 1
        else f"{len(chunks)} chunks, the first {claim} are left out"
    )


def _unpacked(chunk: Chunk, claimed: int) -> bytes | None:
    """None where it is damaged, or unpacks to another size than it claims; takes no more memory than that."""
    try:
        if chunk.compression == "zstd":
            # `zstandard.decompress` would take what the frame's own header asks for.
            unpacker = zstandard.ZstdDecompressor(max_window_size=_WINDOW_BYTES)
            data: bytes = unpacker.stream_reader(chunk.data).read(claimed + 1)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=claimed + 1)
        else:
            data = chunk.data if not chunk.compression else b""
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError):
        return None
    return data if len(data) == claimed else None
