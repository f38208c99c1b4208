"""`crux report`: one HTML page about a plan, a climb or a campaign."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_tools.arguments import taught
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json

if TYPE_CHECKING:
    from crux_msgs import truth_verdict_t

_DESCRIPTION = """Writes one self-contained HTML page about a plan (from crux plan) or a climb (the log from crux climb
or from the robot): the verdict, the cause of every fault, pictures of the robot on the wall, gait, planned and measured
wrenches, limit-surface margins, tracking, grasp forces, joint torques and heat, timing of the control cycle and the
scenario. For simulated climbs, slips and falls are reported. For two logs: both verdicts, and what differs. For a
campaign's folder: rates with their 95 % intervals, by walls, world and method, its failures with pictures, and the
comparison --against another one. Needs no network."""
_EXAMPLES = (
    "crux report out/plan.mcap -o out/plan.html",
    "crux report out/climb.mcap -o out/climb.html --picture out/climb.png",
    "crux report out/before.mcap out/climb.mcap -o out/compared.html",
    "crux report out/campaign --against out/campaign-before -o out/campaign.html",
)


@dataclass(frozen=True)
class Written:
    """What a report was written about."""

    file: Path
    kind: str  # plan, climb, campaign or comparison
    bytes: int


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux report`."""
    parser = subparsers.add_parser(
        "report",
        help="one HTML page about a plan, a climb or a campaign",
        **taught(_DESCRIPTION, *_EXAMPLES),
    )
    parser.add_argument(
        "source", type=Path, metavar="SOURCE", help="a plan or a log (.mcap), or the folder of a campaign"
    )
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER.mcap", help="a second log, to compare with")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.html", help="the page to write")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="also write one large picture, of the middle of the climb"
    )
    parser.add_argument("--against", type=Path, metavar="DIR", help="of a campaign: compare it with this one")
    add_json_option(parser)
    parser.set_defaults(func=run)


def write_report(
    source: Path, output: Path, picture: Path | None = None, verdict: truth_verdict_t | None = None
) -> Written:
    """Writes the page about `source`, and the picture if asked for; `verdict`: of a climb whose log has none.

    Raises LogError or a contract's error where `source` is neither plan nor log, OutputError or OSError where `output`
    cannot be written.
    """
    from crux_contracts.output_file import look_at_outputs, write_whole

    from crux_tools.report import sections
    from crux_tools.report.page import page
    from crux_tools.telemetry import is_log, read_channels, telemetry_of
    from crux_tools.telemetry.summary import summarise

    channels = read_channels(source)
    look_at_outputs({"-o": output, "--picture": picture}, (source,))
    if is_log(channels):
        log = telemetry_of(source, channels)
        summary = summarise(log)
        kind, plan, name = "climb", log.plan, summary.scenario or source.stem
        content = sections.log_sections(log, summary, log.verdict or verdict)
    else:
        from crux_contracts.plan_file import read_plan

        log = None
        plan = read_plan(source)
        kind, name = "plan", plan.scenario_name
        content = sections.plan_sections(plan)
    html = page(f"{kind.capitalize()}: {name}", f"crux report of {source.name}", content).encode()
    write_whole(output, html)
    if picture is not None:
        from crux_tools.report.showpiece import showpiece

        write_whole(picture, showpiece(plan, log))
    return Written(output, kind, len(html))


def write_campaign_report(folder: Path, output: Path, against: Path | None) -> Written:
    """Writes the page about a campaign's folder. Raises UsageError, OutputError, OSError."""
    from crux_contracts.output_file import look_at_outputs, write_whole

    from crux_tools.report.campaign import sections_of
    from crux_tools.report.page import page

    look_at_outputs({"-o": output})
    html = page(f"Campaign: {folder.name}", f"crux report of {folder}", sections_of(folder, against)).encode()
    write_whole(output, html)
    return Written(output, "campaign", len(html))


def write_comparison(paths: tuple[Path, Path], output: Path) -> Written:
    """Writes the page about two climbs. Raises LogError, UsageError, OutputError, OSError."""
    from crux_contracts.output_file import look_at_outputs, write_whole

    from crux_tools.report.comparison import comparison_sections
    from crux_tools.report.page import page

    look_at_outputs({"-o": output}, paths)
    title = f"{paths[0].stem} and {paths[1].stem}"
    html = page(title, f"crux report of {paths[0]} and {paths[1]}", comparison_sections(paths)).encode()
    write_whole(output, html)
    return Written(output, "comparison", len(html))


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the page was written."""
    written = _written(options)
    if options.json:
        print_json({"ok": True, "file": str(written.file), "kind": written.kind, "bytes": written.bytes})
    else:
        note(f"report of the {written.kind}: {written.file} ({written.bytes / 1e6:.1f} MB)")
    return 0


def _written(options: argparse.Namespace) -> Written:
    if options.other is not None:
        for name, given in (("--picture", options.picture), ("--against", options.against)):
            if given is not None:
                raise UsageError(f"{name}: not with two logs")
        return write_comparison((options.source, options.other), options.output)
    if options.source.is_dir():
        if options.picture is not None:
            raise UsageError("--picture: is of a plan or a climb, not of a campaign")
        return write_campaign_report(options.source, options.output, options.against)
    if options.against is not None:
        raise UsageError(f"--against: compares campaigns; {options.source} is not the folder of one")
    return write_report(options.source, options.output, options.picture)
