"""`crux log info`, `cut`, `merge`, `recover`: against mcap's own reader, on whole, cut-off and damaged logs."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.plan_file import write_plan
from crux_tools.cli import main
from crux_tools.telemetry import read_log
from crux_tools.telemetry.records import records_inside
from hand_plan import standing_plan
from made_up_climb import Story, write_log
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from test_log_ls import judge

Messages = Counter[tuple[str, int, bytes]]
METADATA = {"started_utc": "2026-11-22T10:00:00Z", "host": "wall-pc"}


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("edit") / "climb.mcap"
    write_log(path, Story(faults=((200, 7, 1),), metadata=METADATA))
    judge(path, True, 0, "")
    return path


def messages(path: Path) -> Messages:
    with path.open("rb") as file:
        return Counter((channel.topic, m.log_time, m.data) for _, channel, m in make_reader(file).iter_messages())


def said(path: Path) -> dict[str, dict[str, str]]:
    with path.open("rb") as file:
        return {record.name: record.metadata for record in make_reader(file).iter_metadata()}


def files(path: Path) -> dict[str, bytes]:
    with path.open("rb") as file:
        return {record.name: record.data for record in make_reader(file).iter_attachments()}


def notes_of(path: Path) -> list[dict[str, str]]:
    with path.open("rb") as file:
        return [record.metadata for record in make_reader(file).iter_metadata() if record.name == "crux_note"]


def summary_of(path: Path) -> Any:
    with path.open("rb") as file:
        return make_reader(file).get_summary()


def without_summary(file: bytes) -> bytes:
    """A file as the runtime leaves it when it is killed: DataEnd, an empty footer, magic."""
    summary_start = struct.unpack_from("<Q", file, len(file) - 8 - 20)[0]
    return file[:summary_start] + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + file[-8:]


def test_a_cut_has_what_lies_in_it_and_the_plan(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "cut.mcap"
    assert main(["log", "cut", str(log), "-o", str(out), "--from", "1.5", "--to", "2", "--json"]) == 0
    whole, part = messages(log), messages(out)
    inside = {key: n for key, n in whole.items() if 1_500_000_000 <= key[1] <= 2_000_000_000}
    plan = {key: n for key, n in whole.items() if key[0] == "/plan"}
    assert part == Counter(inside | plan)
    assert json.loads(capsys.readouterr().out)["messages"] == sum(part.values())
    assert files(out) == files(log)
    assert said(out) == said(log) | {"crux_cut": {"of": "climb.mcap", "from_s": "1.5", "to_s": "2"}}
    cut, log_read = read_log(out), read_log(log)
    rows = slice(150, 201)
    np.testing.assert_array_equal(cut.state, log_read.state[rows])
    np.testing.assert_array_equal(cut.limbs, log_read.limbs[rows])
    assert cut.plan.plan_id == log_read.plan.plan_id
    assert len(cut.faults) == 1


def test_parts_make_the_whole_again(log: Path, tmp_path: Path) -> None:
    a, b, whole = (tmp_path / name for name in ("a.mcap", "b.mcap", "whole.mcap"))
    assert main(["log", "cut", str(log), "-o", str(a), "--to", "2"]) == 0
    assert main(["log", "cut", str(log), "-o", str(b), "--from", "1.4"]) == 0  # both have 0.6 s of it
    assert main(["log", "merge", str(b), str(a), "-o", str(whole)]) == 0
    assert messages(whole) == messages(log)
    assert files(whole) == files(log)
    again, before = read_log(whole), read_log(log)
    np.testing.assert_array_equal(again.inputs, before.inputs)
    assert again.end == before.end
    assert again.notes == before.notes
    assert again.verdict is not None


@pytest.mark.parametrize("finished", [True, False])
def test_notes_are_added_and_shown(finished: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`finished`: the log has a summary; that of a runtime that was killed has none, yet it ends as MCAP files do."""
    log = tmp_path / "climb.mcap"
    write_log(log, Story(ready_cycles=3, wait_cycles=0, metadata=METADATA | {"note": "New rubber"}))
    if not finished:
        log.write_bytes(without_summary(log.read_bytes()))
    before, statistics = messages(log), summary_of(log)
    assert main(["log", "note", str(log), "left pad\n was wet"]) == 0
    assert main(["log", "note", str(log), "torn since", "--json"]) == 0
    told = "New rubber; left pad was wet; torn since"
    assert json.loads(capsys.readouterr().out)["note"] == told
    assert read_log(log).metadata["note"] == told
    assert main(["log", "info", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["climb"]["note"] == told
    assert messages(log) == before
    if statistics is not None:
        now = summary_of(log)
        assert now is not None
        assert now.statistics.metadata_count == statistics.statistics.metadata_count + 2
        assert now.statistics.message_start_time == statistics.statistics.message_start_time
        assert [record["note"] for record in notes_of(log)] == ["left pad was wet", "torn since"]


def test_what_is_no_note_or_no_log_is_refused(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan, killed = tmp_path / "plan.mcap", tmp_path / "killed.mcap"
    write_plan(plan, standing_plan())
    killed.write_bytes(log.read_bytes()[:-50])
    for words in ((log, " "), (plan, "good"), (killed, "good"), (tmp_path / "none.mcap", "good")):
        content = words[0].read_bytes() if words[0].exists() else b""
        assert main(["log", "note", str(words[0]), words[1]]) == 2
        assert len(capsys.readouterr().err.strip().splitlines()) == 1
        assert (words[0].read_bytes() if words[0].exists() else b"") == content


def test_logs_of_two_runs_are_not_merged(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other, out = tmp_path / "other.mcap", tmp_path / "out.mcap"
    write_log(other, Story(ready_cycles=3, wait_cycles=0, metadata=METADATA | {"started_utc": "2026-11-23T10:00:00Z"}))
    assert main(["log", "merge", str(log), str(other), "-o", str(out)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "its started_utc is 2026-11-23T10:00:00Z, not 2026-11-22T10:00:00Z" in lines[0]
    assert not out.exists()


def test_a_log_that_was_cut_off_is_whole_again(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, whole = log.read_bytes(), messages(log)
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    found = []
    for share in (0.3, 0.6, 0.9):
        broken.write_bytes(data[: int(share * len(data))])
        assert main(["log", "recover", str(broken), "-o", str(out), "--json"]) == 0
        answer = json.loads(capsys.readouterr().out)
        assert "cut off" in answer["lost"][0]
        kept = messages(out)  # by the index: it has one
        assert kept == kept & whole
        found.append(sum(kept.values()))
        np.testing.assert_array_equal(read_log(out).inputs, read_log(broken).inputs)
        assert files(out) == files(log)
    assert found == sorted(found)
    assert found[0] > 0
    assert main(["log", "merge", str(broken), str(log), "-o", str(tmp_path / "m.mcap")]) == 2
    assert "recover it first" in capsys.readouterr().err


def test_a_damaged_chunk_is_left_out_and_said(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    data = bytearray(log.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    broken, out = tmp_path / "broken.mcap", tmp_path / "out.mcap"
    broken.write_bytes(data)
    assert main(["log", "recover", str(broken), "-o", str(out)]) == 0
    assert "a damaged chunk is left out" in capsys.readouterr().err
    whole, kept = messages(log), messages(out)
    assert 0 < sum((whole - kept).values()) < sum(whole.values()) / 2
    assert not kept - whole
    assert main(["log", "info", str(broken), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["damage"] == ["a damaged chunk is left out"]


def test_info_counts_what_another_reader_counts(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "info", str(log), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    whole = messages(log)
    for channel in told["channels"]:
        mine = [(time, data) for (topic, time, data), n in whole.items() for _ in range(n) if topic == channel["topic"]]
        assert channel["messages"] == len(mine)
        assert channel["bytes"] == sum(len(data) for _, data in mine)
        if mine:
            assert round(channel["from_s"] * 1e9) == min(time for time, _ in mine)
            assert round(channel["to_s"] * 1e9) == max(time for time, _ in mine)
    assert {channel["topic"] for channel in told["channels"]} == {topic for topic, *_ in whole}
    assert told["climb"]["verdict"] == "climbed"
    assert dict(told["metadata"])["crux"]["host"] == "wall-pc"
    assert set(told["attachments"]) == set(files(log))
    assert main(["log", "info", str(log)]) == 0
    text = capsys.readouterr().out
    assert "started_utc: 2026-11-22T10:00:00Z" in text
    assert "crux_msgs/msg/RobotState" in text


def test_a_log_with_an_index_is_not_read_message_by_message(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What info says is the same; a cut takes the chunks apart that it is about, and that of the plan."""
    plain, whole = tmp_path / "climb.mcap", summary_of(log).chunk_indexes
    plain.write_bytes(without_summary(log.read_bytes()))
    told = []
    for path in (plain, log):
        assert main(["log", "info", str(path), "--json"]) == 0
        told.append(json.loads(capsys.readouterr().out))
        del told[-1]["bytes"], told[-1]["climb"]["path"], told[-1]["climb"]["bytes"]
        monkeypatch.setattr("crux_tools.log.edit.records", lambda *_: pytest.fail("it was read from the start"))
        monkeypatch.setattr("crux_tools.log.index.entry_of", lambda *_: pytest.fail("it was read from the start"))
    assert told[0].pop("climb").items() >= {(k, v) for k, v in told[1]["climb"].items() if k != "faults"}
    assert told[1].pop("climb")["verdict"] == "climbed"
    assert told[0] == told[1]

    taken: list[bytes] = []

    def taken_apart(content: bytes) -> Iterator[Schema | Channel | Message]:
        taken.append(content)
        return records_inside(content)

    monkeypatch.setattr("crux_tools.log.edit.records_inside", taken_apart)
    assert main(["log", "cut", str(log), "-o", str(tmp_path / "cut.mcap"), "--from", "3", "--to", "3.1"]) == 0
    first_ns, last_ns = 3_000_000_000, 3_100_000_000
    about = [i for i in whole if i.message_start_time <= last_ns and i.message_end_time >= first_ns]
    assert len(about) <= len(taken) <= len(about) + 2 < len(whole)


def test_tables_that_come_to_nothing_leave_no_folder(log: Path, tmp_path: Path) -> None:
    broken, kept = tmp_path / "broken.mcap", tmp_path / "kept"
    broken.write_bytes(log.read_bytes()[:3000])
    kept.mkdir()
    for form in ("--csv", "--parquet"):
        assert main(["log", "export", str(broken), "-o", str(tmp_path / "tables"), form]) == 2
        assert main(["log", "export", str(broken), "-o", str(kept), form]) == 2
    assert not (tmp_path / "tables").exists()
    assert kept.is_dir()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["cut", "LOG", "-o", "LOG", "--to", "1"], "is the input"),
        (["cut", "LOG", "-o", "OUT"], "--from and --to: give one of them at least"),
        (["cut", "LOG", "-o", "OUT", "--from", "3", "--to", "2"], "the second not before the first"),
        (["cut", "LOG", "-o", "OUT", "--from", "90"], "nothing in it from 90 to"),
        (["recover", "LOG", "-o", "LOG"], "is the input"),
        (["recover", "DIR", "-o", "OUT"], "is a folder"),
        (["recover", "MISSING", "-o", "OUT"], "no such file"),
        (["recover", "TEXT", "-o", "OUT"], "not an MCAP file"),
        (["merge", "LOG", "-o", "OUT"], "give two logs or more"),
        (["merge", "LOG", "LOG", "-o", "LOG"], "is the input"),
        (["info", "TEXT"], "not an MCAP file"),
        (["export", "TEXT", "-o", "OUT", "--csv"], "not an MCAP file"),
    ],
)
def test_wrong_input_is_one_line_and_costs_nothing(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], named: str
) -> None:
    text = tmp_path / "text.mcap"
    text.write_text("no log")
    places = {
        "LOG": log,
        "OUT": tmp_path / "out.mcap",
        "DIR": tmp_path,
        "TEXT": text,
        "MISSING": tmp_path / "none.mcap",
    }
    before = log.read_bytes()
    assert main(["log", *(str(places.get(word, word)) for word in words)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert named in lines[0]
    assert log.read_bytes() == before
    assert not places["OUT"].is_file()
    assert not [each for each in tmp_path.iterdir() if each.name.startswith(".")]
