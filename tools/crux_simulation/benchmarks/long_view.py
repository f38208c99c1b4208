"""`crux bench view`: how long an hour's log takes to open in the viewer, and how many moments a second it shows."""

from __future__ import annotations

import argparse
import math
import time
import urllib.request
from contextlib import suppress
from pathlib import Path
from typing import Any

from crux_tools.arguments import positive
from crux_tools.output import note, print_json, progress
from crux_tools.view.browser import open_page
from crux_tools.view.command import source_of
from crux_tools.view.pictures import READY, SIZE_PX
from crux_tools.view.server import ALL, Viewer
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from crux_simulation.benchmarks.cold_process import HANGING, measured, planned_scene
from crux_simulation.benchmarks.setting import setting

CLIMB_LIMIT_S = 300.0
MOST_OPEN_S, LEAST_A_S = 5.0, 20.0
MOMENTS = 100
SCRUB_S = 5.0
_CYCLE_AT = 4  # of a message that begins with its cycle, behind the CDR header
# Seeks from moment to moment as somebody who drags the cursor does, the next when the last one is shown.
_SCRUB = """(async () => {
  const { view, page, begin, end, seek } = crux, shown = view.shown;
  const start = performance.now(), past = () => (performance.now() - start) / 1000;
  for (let i = 1; past() < %g; i++) {
    seek(begin() + (end() - begin()) * ((i * 0.618) %% 1));
    await new Promise(requestAnimationFrame);
    while (page.asking) await new Promise((done) => setTimeout(done, 1));
  }
  return (view.shown - shown) / past();
})()"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench view`."""
    parser.add_argument("--scene", default="climb-four-holds", metavar="NAME", help="a shipped scene")
    parser.add_argument("--minutes", type=positive, default=60.0, metavar="N", help="of log (default: %(default)g)")
    parser.add_argument("--output", type=Path, default=Path("out/bench-view"), metavar="DIR", help="for plan and logs")


def repeated(source: Path, target: Path, length_s: float) -> None:
    """A log in which a climb comes again and again until it is as long; its plan once, its end once."""
    with source.open("rb") as file, target.open("wb") as out, progress("writing the log", length_s) as bar:
        reader, writer = make_reader(file), Writer(out, chunk_size=1 << 19, compression=CompressionType.LZ4)
        messages = [(s, c, m) for s, c, m in reader.iter_messages(log_time_order=False) if s is not None]
        writer.start(profile="ros2", library="crux bench view")
        for each in reader.iter_attachments():
            writer.add_attachment(each.create_time, each.log_time, each.name, each.media_type, each.data)
        metadata = list(reader.iter_metadata())
        for said in metadata[:-1]:
            writer.add_metadata(said.name, said.metadata)
        numbers: dict[int, int] = {}
        for schema, channel, _ in messages:
            if channel.id not in numbers:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[channel.id] = writer.register_channel(channel.topic, "cdr", schema_id, channel.metadata)
        counts = {c.id for s, c, _ in messages if b"int64 cycle" in s.data.splitlines()[:9]}
        last_ns, last_cycle = max(m.log_time for *_, m in messages), 0
        for _, channel, message in messages:
            if channel.topic == "/control_input":
                last_cycle = int.from_bytes(message.data[_CYCLE_AT : _CYCLE_AT + 8], "little")
        for times in range(math.ceil(length_s * 1e9 / last_ns)):
            for _, channel, message in messages:
                data, at_ns = message.data, message.log_time + times * last_ns
                if times and (channel.topic == "/plan" or message.log_time == 0):
                    continue
                if channel.id in counts:
                    cycle = int.from_bytes(data[_CYCLE_AT : _CYCLE_AT + 8], "little") + times * last_cycle
                    data = data[:_CYCLE_AT] + cycle.to_bytes(8, "little") + data[_CYCLE_AT + 8 :]
                writer.add_message(numbers[channel.id], at_ns, data, at_ns)
            bar.at(times * last_ns / 1e9)
        writer.add_metadata(metadata[-1].name, metadata[-1].metadata)
        writer.finish()  # type: ignore[no-untyped-call]


def _log(options: argparse.Namespace) -> Path:
    """What is there already is taken."""
    folder: Path = options.output
    climb, log = folder / "climb.mcap", folder / f"{options.minutes:g}-minutes.mcap"
    if not log.exists():
        planned_scene(options.scene, folder)
        words = ("climb", str(folder / "plan.mcap"), "-o", str(climb))
        measured("crux_tools.cli", *words, limit_s=CLIMB_LIMIT_S * HANGING)
        part = log.with_suffix(".part")
        repeated(climb, part, options.minutes * 60)
        part.rename(log)
    return log


def _cpu_s() -> float:
    """Of this process and of what it has started, Chromium's processes among them."""
    import psutil

    found = 0.0
    for process in [psutil.Process(), *psutil.Process().children(recursive=True)]:
        with suppress(psutil.Error):  # one that has ended
            spent = process.cpu_times()
            found += spent.user + spent.system
    return found


def looked_at(log: Path) -> dict[str, Any]:
    """CPU seconds until the log is open, and moments a second: by the server alone, and in a browser."""
    begin_s, begin_cpu_s = time.monotonic(), time.process_time()
    source = source_of(log)
    viewer = Viewer([source], "127.0.0.1", 0)
    opened = {"open_s": time.monotonic() - begin_s, "open_cpu_s": time.process_time() - begin_cpu_s}
    try:
        time_s = source(*ALL).log.time_s
        first_s, span_s = float(time_s[0]), float(time_s[-1] - time_s[0])
        begin_s, begin_cpu_s = time.monotonic(), time.process_time()
        for i in range(MOMENTS):
            at = f"/at?time_s={first_s + span_s * (0.618 * i % 1)}&span_s={span_s}"
            with urllib.request.urlopen(viewer.url + at) as answer:
                answer.read()
        served = {
            "served_a_s": MOMENTS / (time.monotonic() - begin_s),
            "served_cpu_ms": 1e3 * (time.process_time() - begin_cpu_s) / MOMENTS,
        }
        with open_page(viewer.url, SIZE_PX) as page:
            page.wait_until(READY)
            before_s, shown = _cpu_s(), page.value("crux.view.shown")
            scrubbed = page.value(_SCRUB % SCRUB_S)
            cpu_ms = 1e3 * (_cpu_s() - before_s) / (page.value("crux.view.shown") - shown)
        return {**opened, **served, "scrubbed_a_s": scrubbed, "scrubbed_cpu_ms": cpu_ms}
    finally:
        viewer.close()


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when it opens in MOST_OPEN_S of CPU time and shows LEAST_A_S moments a second in the browser."""
    log = _log(options)
    found = looked_at(log)
    ok = found["open_cpu_s"] <= MOST_OPEN_S and found["scrubbed_a_s"] >= LEAST_A_S
    if options.json:
        print_json({"ok": ok, "log": str(log), "bytes": log.stat().st_size, **found, **setting()})
        return 0 if ok else 1
    machine = setting()["machine"]
    note(f"{log}: {options.minutes:g} min, {log.stat().st_size / 1e9:.2f} GB; load {machine['load']} on this machine")
    note(f"open after {found['open_cpu_s']:.1f} s of CPU time, {found['open_s']:.1f} s by the clock ({MOST_OPEN_S:g})")
    note(f"served   {found['served_a_s']:6.1f} moments/s, {found['served_cpu_ms']:.1f} ms of CPU time each")
    note(
        f"scrubbed {found['scrubbed_a_s']:6.1f} moments/s in Chromium without a graphics card ({LEAST_A_S:g}),"
        f" {found['scrubbed_cpu_ms']:.0f} ms of CPU time each, the server's with it"
    )
    return 0 if ok else 1
