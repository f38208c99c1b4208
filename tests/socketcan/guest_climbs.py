"""Runs inside a kernel with SocketCAN: `crux climb` time after time in one process, for imports take seconds there.

python guest_climbs.py FOLDER: FOLDER/climbs.json lists [NAME, words after `crux climb`, buses to be recorded]. What
each prints goes to NAME.json, with its exit status and the number of frames on each bus, and to NAME.said; its log goes
to NAME.mcap, the frames to NAME/. Record few: candump takes a tenth of a millisecond for a frame.
"""

from __future__ import annotations

import contextlib
import io
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from crux_simulation.sim import disturbance
from crux_tools.cli import main
from with_can import BUSES

WATCHED_S = 2.0  # after a fault, in place of four: time for a bus to be believed again
SETTLE_S = 0.5


def sent() -> dict[str, int]:
    """Frames on each bus until now."""
    return {bus: int(Path(f"/sys/class/net/{bus}/statistics/tx_packets").read_text()) for bus in BUSES.split(",")}


@contextlib.contextmanager
def recorded(folder: Path, buses: Sequence[str]) -> Iterator[None]:
    """The frames on some buses into a file of `folder`."""
    folder.mkdir()
    with subprocess.Popen(["candump", "-l", *buses], cwd=folder, stdout=subprocess.DEVNULL) as candump:
        time.sleep(SETTLE_S)
        yield
        time.sleep(SETTLE_S)
        candump.send_signal(signal.SIGINT)


def climb(folder: Path, name: str, words: Sequence[str], buses: Sequence[str]) -> None:
    """One climb."""
    printed, said, before = io.StringIO(), io.StringIO(), sent()
    recording = recorded(folder / name, buses) if buses else contextlib.nullcontext()
    with recording, contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        status = main(["climb", *words, "-o", str(folder / f"{name}.mcap"), "--json"])
    frames = {bus: count - before[bus] for bus, count in sent().items()}
    result = json.loads(printed.getvalue()) | {"status": status, "frames": frames}
    (folder / f"{name}.json").write_text(json.dumps(result))
    (folder / f"{name}.said").write_text(said.getvalue())


if __name__ == "__main__":
    disturbance.WATCHED_S = WATCHED_S
    place = Path(sys.argv[1])
    for each in json.loads((place / "climbs.json").read_text()):
        climb(place, *each)
