"""`crux view` and `crux watch`: the viewer in the browser."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_tools.arguments import positive, taught
from crux_tools.errors import UsageError
from crux_tools.output import note
from crux_tools.page_address import add_address, check_address

if TYPE_CHECKING:
    from crux_tools.view.server import Source

FILMS = (".mp4", ".webp", ".gif")
_VIEW = """Shows a log or a plan in the browser: the robot on its wall in 3-D, and below it one time line with states,
waits, gait and events, and plots of any signal with a common cursor. Two logs have a 3-D view each; they are aligned at
the start of the climb, and plots show both, or the difference. Needs no network."""
_WATCH = """Shows a running climb in the browser, live from LCM at 50 Hz, with its history since the command started:
the robot in 3-D, time line and plots as in crux view. Joints are not on LCM: they are computed from body and grippers.
The wall is that of PLAN.mcap, or of the next plan that the runtime accepts. Sends nothing."""
_VIEW_EXAMPLES = (
    "crux view out/climb.mcap --at 12.5",
    "crux view out/plan.mcap",
    "crux view out/climb.mcap out/other.mcap",
    "crux view out/climb.mcap --at 12.5 --screenshot out/moment.png",
    "crux view out/climb.mcap --video out/swing.mp4 --from 33 --to 47",
)
_WATCH_EXAMPLES = ("crux watch out/plan.mcap", "crux watch --lcm 'udpm://239.255.76.67:7667?ttl=1'")


def _film(text: str) -> Path:
    if Path(text).suffix not in FILMS:
        raise argparse.ArgumentTypeError(
            f"'{text}': expected a name that ends in {', '.join(FILMS[:-1])} or {FILMS[-1]}"
        )
    return Path(text)


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux view`."""
    parser = subparsers.add_parser("view", help="show a log or a plan in the browser", **taught(_VIEW, *_VIEW_EXAMPLES))
    parser.add_argument("source", type=Path, metavar="LOG|PLAN.mcap", help="telemetry of a climb, or a plan")
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER.mcap", help="another one to compare with")
    parser.add_argument("--at", type=float, default=math.nan, metavar="S", help="the moment to start at [s]")
    parser.add_argument("--screenshot", type=Path, metavar="FILE.png", help="write a picture of the page (by Chromium)")
    parser.add_argument("--video", type=_film, metavar="FILE.mp4", help="write a video (or .webp, .gif)")
    parser.add_argument("--from", type=float, default=-math.inf, dest="from_s", metavar="S", help="its start [s]")
    parser.add_argument("--to", type=float, default=math.inf, dest="to_s", metavar="S", help="its end [s]")
    parser.add_argument("--speed", type=positive, default=4.0, metavar="X", help="its speed (default: %(default)g)")
    add_address(parser)
    parser.set_defaults(func=run)


def add_watch_parser(subparsers: Any) -> None:
    """Adds the parser of `crux watch`."""
    from crux_tools.operator_link import DEFAULT_URL

    parser = subparsers.add_parser("watch", help="show a running climb", **taught(_WATCH, *_WATCH_EXAMPLES))
    parser.add_argument("plan", type=Path, nargs="?", metavar="PLAN.mcap", help="the plan that is climbed")
    parser.add_argument("--lcm", default=DEFAULT_URL, metavar="URL", help="LCM URL of the runtime (%(default)s)")
    add_address(parser)
    parser.set_defaults(func=run_watch)


def serve(sources: list[Source], host: str, port: int, at_s: float = math.nan) -> None:
    """Until Ctrl-C. `at_s`: where the page begins, NaN: at the recording's begin."""
    from crux_tools.view.page_server import serve as serve_page
    from crux_tools.view.server import Viewer, moment

    serve_page(Viewer(sources, host, port), "view", moment(at_s))


def source_of(path: Path) -> Source:
    """Of a log, whole or by what is looked at where it is long, or of a plan. Raises UsageError, LogError."""
    from crux_tools.telemetry.chunks import span_s
    from crux_tools.view.long_log import LONG_S, LongLog
    from crux_tools.view.recording import recording_of
    from crux_tools.view.server import ALL, still

    from_s, to_s = span_s(path) if path.is_file() else (0.0, 0.0)
    if to_s - from_s > LONG_S:
        source: Source = LongLog(path).between
        note(f"crux view: {path.name}: a long log: some moments of it, every cycle where the page shows 20 s or less")
    else:
        recording = recording_of(path)
        if recording is None:
            raise UsageError(f"{path}: no plan was accepted in this log, so there is no wall to show")
        source = still(recording)
    for remark in source(*ALL).log.notes:
        note(f"crux view: {path.name}: {remark}")
    return source


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when it was shown, or when the picture was written."""
    from crux_contracts.output_file import look_at_outputs

    check_address(options.host, options.port)
    paths = [path for path in (options.source, options.other) if path is not None]
    look_at_outputs({"--screenshot": options.screenshot, "--video": options.video}, tuple(paths))
    sources = [source_of(path) for path in paths]
    if options.screenshot is None and options.video is None:
        serve(sources, options.host, options.port, options.at)
    else:
        _pictures(sources, options)
    return 0


def _pictures(sources: list[Source], options: argparse.Namespace) -> None:
    from crux_tools.view.pictures import write_screenshot, write_video

    if options.screenshot is not None:
        write_screenshot(options.screenshot, sources, options.at)
        note(f"picture: {options.screenshot}")
    if options.video is not None:
        time_s = sources[0](-math.inf, math.inf).log.time_s
        from_s, to_s = max(float(time_s[0]), options.from_s), min(float(time_s[-1]), options.to_s)
        if from_s >= to_s:
            raise UsageError(f"--from, --to: nothing lies between; it goes from {time_s[0]:g} to {time_s[-1]:g} s")
        frames = write_video(options.video, sources, from_s, to_s, options.speed)
        note(f"video: {options.video}, {frames} frames")


def run_watch(options: argparse.Namespace) -> int:
    """Exit status 0 when it was ended by Ctrl-C."""
    from crux_contracts.plan_file import read_plan

    check_address(options.host, options.port)
    from crux_tools.view.live import Live
    from crux_tools.view.page_server import serve as serve_page
    from crux_tools.view.server import Viewer

    plan = None if options.plan is None else read_plan(options.plan)
    live = Live(options.lcm, plan)
    try:
        note(f"crux watch: listening on {options.lcm} for a runtime{'' if plan else ' and a plan it takes'}")
        live.wait_for_first()
        viewer = Viewer([live.recording], options.host, options.port)
    except KeyboardInterrupt:
        return 0
    serve_page(viewer, "view")
    return 0
