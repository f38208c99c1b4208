"""Logs whose chunks unpack to gigabytes, or whose index names things again and again: little memory is taken, what is
left out is said, and all else is read as if it was not there."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from crux_tools.telemetry import LogError, read_channels, read_log
from crux_tools.telemetry.part import read_part
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Attachment, Chunk, ChunkIndex, DataEnd, Footer, Metadata, MetadataIndex
from mcap.summary import Summary
from mcap.writer import Writer

HUGE = 1_500_000_000  # bytes unpacked
LARGE = 50_000_000  # of which one is unpacked, not twenty
LIMIT_KB = 700_000  # of the process that reads; a report of the log without a bomb takes 450 MB
_READ = """
import resource, sys
resource.setrlimit(resource.RLIMIT_DATA, (1_400_000_000, 1_400_000_000))
from pathlib import Path
from crux_tools.cli import main
from crux_tools.view.command import source_of
*logs, out = sys.argv[1:]
commands = sys.stdin.read().splitlines()
if any(words.startswith("report") for words in commands):
    from crux_tools.report import sections
    sections.PICTURE_PX = (64, 46)  # so few take no time
for log in logs:
    for words in commands:
        code = main(words.replace("LOG", log).replace("OUT", out).split())
        assert code in (0, 2), (log, words, code)
    source_of(Path(log))
print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))  # since exec
"""
CUT = "log cut LOG -o OUT/cut.mcap --from 1 --to 2"
ALL = (
    "report LOG -o OUT/page.html",
    "log info LOG",
    "log recover LOG -o OUT/recovered.mcap",
    CUT,
    "log merge LOG LOG -o OUT/merged.mcap",
    "log note LOG wet",
    "log ls OUT",
)


def filler(size: int) -> Iterable[bytes]:
    """A record of a kind that readers skip."""
    yield struct.pack("<BQ", 0x80, size - 9)
    yield bytes(1_000_000 - 9)
    block = bytes(1_000_000)
    yield from (block for _ in range(size // len(block) - 1))


@cache
def zstd(size: int, told: bool = True) -> bytes:
    """A frame that says what it holds, or does not."""
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=size if told else -1)
    return b"".join(map(packer.compress, filler(size))) + packer.flush()


def silent_zstd(size: int) -> bytes:
    return zstd(size, told=False)


@cache
def lz4_frame(size: int) -> bytes:
    packer = lz4.frame.LZ4FrameCompressor(block_size=lz4.frame.BLOCKSIZE_MAX4MB)
    return bytes(packer.begin() + b"".join(map(packer.compress, filler(size))) + packer.flush())


def chunk(kind: str, data: bytes, claimed: int) -> Chunk:
    return Chunk(kind, data, 10**18, 0, 0, claimed)


def bytes_of(*records: object) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)  # type: ignore[attr-defined]
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def with_records(log: Path, path: Path, added: list[bytes], index: Callable[[Summary, list[int]], None]) -> None:
    """A log with more records, and with what `index` puts into its summary about them and where they begin."""
    old = log.read_bytes()
    summary = make_reader(io.BytesIO(old)).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    end_at = int.from_bytes(old[-28:-20], "little") - len(bytes_of(DataEnd(0)))
    starts = [end_at + sum(map(len, added[:n])) for n in range(len(added))]
    index(summary, starts)
    data = old[:end_at] + b"".join(added) + bytes_of(DataEnd(0))
    told = [*summary.schemas.values(), *summary.channels.values(), summary.statistics]
    indexes = [*summary.chunk_indexes, *summary.attachment_indexes, *summary.metadata_indexes]
    path.write_bytes(data + bytes_of(*told, *indexes, Footer(len(data), 0, 0)) + old[-8:])


def with_chunks(log: Path, path: Path, chunks: list[Chunk]) -> None:
    def index(summary: Summary, starts: list[int]) -> None:
        assert summary.statistics is not None
        plan = summary.chunk_indexes[0]  # so that all who look for a plan look into them
        for at, one in zip(starts, chunks, strict=True):
            summary.chunk_indexes.append(
                ChunkIndex(
                    chunk_length=len(bytes_of(one)),
                    chunk_start_offset=at,
                    compression=one.compression,
                    compressed_size=len(one.data),
                    message_end_time=10**18,
                    message_index_length=0,
                    message_index_offsets=dict.fromkeys(plan.message_index_offsets, 0),
                    message_start_time=0,
                    uncompressed_size=one.uncompressed_size,
                )
            )
        summary.statistics.chunk_count += len(chunks)

    with_records(log, path, [bytes_of(one) for one in chunks], index)


def peak_kb(logs: Path | list[Path], out: Path, *commands: str) -> int:
    """The most memory that these commands, and the viewer, take of a log, or of several one after the other."""
    child = subprocess.run(  # noqa: PLW1510
        [sys.executable, "-c", _READ, *(logs if isinstance(logs, list) else [logs]), out],
        input="\n".join(commands),
        capture_output=True,
        text=True,
        env=os.environ | {"XDG_CACHE_HOME": str(out / "cache")},
    )
    assert child.returncode == 0, child.stderr[-3000:]
    assert "internal error" not in child.stderr
    return int(child.stdout.split()[-1])


@pytest.mark.parametrize(
    ("kind", "pack", "claimed", "said"),
    [
        ("zstd", zstd, HUGE, "which claims to hold 1500.0 MB, is left out: no more than 64 MB of one are unpacked"),
        pytest.param("zstd", zstd, 1000, "a damaged chunk is left out", marks=pytest.mark.sweep),
        pytest.param("zstd", silent_zstd, 1000, "a damaged chunk is left out", marks=pytest.mark.sweep),
        pytest.param("lz4", lz4_frame, HUGE, "which claims to hold 1500.0 MB, is left out", marks=pytest.mark.sweep),
        ("lz4", lz4_frame, 1000, "a damaged chunk is left out"),
    ],
)
def test_a_chunk_that_unpacks_to_gigabytes_is_left_out_and_said(
    kind: str, pack: Callable[[int], bytes], claimed: int, said: str, log_path: Path, tmp_path: Path
) -> None:
    bomb = tmp_path / "bomb.mcap"
    with_chunks(log_path, bomb, [chunk(kind, pack(HUGE), claimed)])
    assert peak_kb(bomb, tmp_path, *(ALL if pack is zstd and claimed == HUGE else [CUT])) < LIMIT_KB
    whole, read = read_log(log_path), read_log(bomb)
    assert len(read.notes) == len(whole.notes) + 1
    assert said in read.notes[0]
    np.testing.assert_array_equal(read.inputs, whole.inputs)
    assert read.plan.plan_id == whole.plan.plan_id
    assert said in "".join(read_part(bomb, -1.0, 9.0, 10**6, 10**6).notes)
    if (recovered := tmp_path / "recovered.mcap").exists():  # merge asks for that first
        np.testing.assert_array_equal(read_log(recovered).limbs, whole.limbs)


def test_many_chunks_are_left_out_from_where_they_are_too_much_in_all(log_path: Path, tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.mcap"
    with_chunks(log_path, bomb, [chunk("zstd", zstd(LARGE), LARGE)] * 20)
    assert peak_kb(bomb, tmp_path, CUT) < LIMIT_KB
    whole, read = read_log(log_path), read_log(bomb)
    (note,) = [note for note in read.notes if note not in whole.notes]
    assert note.startswith("19 chunks, the first at byte ")
    assert "which claims to hold 50.0 MB, are left out: of a file of this size no more than " in note
    np.testing.assert_array_equal(read.inputs, whole.inputs)


def test_a_summary_that_holds_a_chunk_is_not_unpacked(log_path: Path, tmp_path: Path) -> None:
    """`index` and `metadata`: the index of metadata names a chunk."""
    bomb, other = tmp_path / "bomb.mcap", tmp_path / "other.mcap"
    old = log_path.read_bytes()
    summary_at = int.from_bytes(old[-28:-20], "little")
    inside = bytes_of(chunk("zstd", zstd(HUGE), HUGE))
    bomb.write_bytes(old[:summary_at] + inside + old[summary_at:-37] + bytes_of(Footer(summary_at, 0, 0)) + old[-8:])

    def index(summary: Summary, starts: list[int]) -> None:
        summary.metadata_indexes.append(MetadataIndex(starts[0], len(inside), "crux"))

    with_records(log_path, other, [inside], index)
    assert peak_kb([bomb, other], tmp_path, CUT, "log note LOG wet") < LIMIT_KB


def test_what_an_index_names_a_thousand_times_is_read_once(log_path: Path, tmp_path: Path) -> None:
    bomb, other = tmp_path / "bomb.mcap", tmp_path / "other.mcap"
    note = bytes_of(Metadata("crux_note", {"note": "n" * 1_000_000}))

    def notes(summary: Summary, starts: list[int]) -> None:
        summary.metadata_indexes += [MetadataIndex(starts[0], len(note), "crux_note")] * 1000

    with_records(log_path, bomb, [note], notes)
    assert read_part(bomb, -1.0, 9.0, 10**6, 10**6).metadata["note"].count("n") == 1_000_000

    def chunks(summary: Summary, _: list[int]) -> None:
        assert summary.statistics is not None
        summary.chunk_indexes *= 300
        summary.statistics.chunk_count *= 300

    with_records(log_path, other, [], chunks)
    assert peak_kb([bomb, other], tmp_path, "log info LOG") < LIMIT_KB
    found = read_part(other, -1.0, 9.0, 10**6, 10**6).tables
    np.testing.assert_array_equal(
        found["/control_input"], read_part(log_path, -1, 9, 10**6, 10**6).tables["/control_input"]
    )


def test_an_attachment_that_claims_more_than_the_file_has_takes_nothing(log_path: Path, tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.mcap"
    whole = bytearray(bytes_of(Attachment(0, 0, "a", "b", b"c" * 100)))
    at = whole.index(b"c" * 100) - 8
    whole[at : at + 8] = (2**62).to_bytes(8, "little")
    with_records(log_path, bomb, [bytes(whole)], lambda *_: None)
    assert peak_kb(bomb, tmp_path, "log recover LOG -o OUT/out.mcap", "log note LOG wet") < LIMIT_KB


INNER = "float64 x\nX[] xs\n" + "=" * 80 + "\nMSG: a/X\n"


@pytest.mark.parametrize(
    ("definition", "said"),
    [
        (INNER + "uint8[4] a\n", "a/X may take 0 bytes, expected 8 at least"),  # which it may read past the end
        (INNER + "uint8 a\n", "a/X may take 1 bytes"),
        (INNER + "Y y\n" + "=" * 80 + "\nMSG: a/Y\nfloat64 a\n", "a/X may take 8 bytes, expected 16 at least"),
        ("float64[10000] a\n", "messages of 80000 bytes, expected at most 16384"),
    ],
)
def test_a_definition_by_which_few_bytes_are_much_is_refused(definition: str, said: str, tmp_path: Path) -> None:
    log = tmp_path / "bomb.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        schema = writer.register_schema("a/msg/B", "ros2msg", definition.encode())
        channel = writer.register_channel("/any", "cdr", schema)
        writer.add_message(channel, 0, b"\0\1\0\0" + bytes(8) + (2_000_000).to_bytes(4, "little"), 0)
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(LogError, match="channel /any does not fit its own definition: ") as refusal:
        read_channels(log)
    assert said in str(refusal.value)
