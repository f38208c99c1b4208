"""What a report says about a campaign, and about two of them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from crux_tools.errors import UsageError
from crux_tools.report.page import Section
from crux_tools.report.pictures import Picture, open_stage
from crux_tools.report.renderer import NoGraphicsError
from crux_tools.report.results import ERROR, FAILURES, LOG_FILE, ROWS, SUCCESSES, Row, read_rows
from crux_tools.report.statistics import Rate, difference, paired_difference

MAX_PICTURES, MAX_FAILURES = 6, 100
PICTURE_PX = (640, 460)
GROUPS = ("walls", "world", "method")
MAX_GROUPS = 50
_INTERVALS = "In brackets: 95 % intervals, {}."
_ERRORS = " Jobs that ended with an error of their own are in no rate."


def campaign_rows(folder: Path) -> list[Row]:
    """Raises UsageError where `folder` has none."""
    rows = read_rows(folder) if (folder / ROWS).is_dir() else []
    if not rows:
        raise UsageError(f"{folder}: no results of a campaign in this folder: expected {ROWS}/KEY.json")
    return rows


def success(rows: list[Row]) -> Rate:
    """Climbed, or planned where that was all."""
    judged = [row for row in rows if row["verdict"] != ERROR]
    return Rate(sum(row["verdict"] in SUCCESSES for row in judged), len(judged))


def planned(rows: list[Row]) -> Rate:
    """With a plan that passes the check."""
    judged = [row for row in rows if row["verdict"] != ERROR]
    return Rate(sum(row.get("check", {}).get("ok", False) for row in judged), len(judged))


def campaign_sections(folder: Path, rows: list[Row]) -> list[Section]:
    """Everything about one campaign."""
    verdicts = Counter(row["verdict"] for row in rows)
    cpu_s = sum(row.get("cpu_s", 0.0) for row in rows)
    commits = Counter(row["commit"] for row in rows if "commit" in row)
    differing = sorted({f"{row['worker']}: {row['differs']}" for row in rows if row.get("differs")})
    overview = Section(
        "campaign",
        "Campaign",
        verdict=f"Succeeded: {success(rows)}",
        explanation=_INTERVALS.format("Wilson's") + _ERRORS,
        rows=[
            ("results", ", ".join(f"{count} {verdict}" for verdict, count in verdicts.most_common())),
            ("planned, and passed the check", str(planned(rows))),
            ("computing", f"{cpu_s / len(rows):.1f} s a job, {cpu_s / 3600:.2f} h in all"),
            ("crux", ", ".join(f"commit {commit}: {count}" for commit, count in commits.most_common())),
        ],
        notes=[f"Worker {worker}" for worker in differing],
    )
    rates = Section("rates", "Rates", table=_rate_table(rows))
    return [overview, rates, *_failures(folder, rows)]


def _groups(rows: list[Row]) -> list[tuple[str, str]]:
    """Column and value of every group that is not everything."""
    groups = []
    for column in GROUPS:
        values = list(dict.fromkeys(row[column] for row in rows))
        if 1 < len(values) <= MAX_GROUPS:
            groups += [(column, value) for value in values]
    return groups


def _rate_table(rows: list[Row]) -> list[tuple[str, ...]]:
    table: list[tuple[str, ...]] = [("", "", "planned and checked", "succeeded")]
    for column, value in _groups(rows):
        group = [row for row in rows if row[column] == value]
        table.append((column, str(value), str(planned(group)), str(success(group))))
    return [*table, ("all", "", str(planned(rows)), str(success(rows)))]


def _failures(folder: Path, rows: list[Row]) -> list[Section]:
    failed = [row for row in rows if row["verdict"] not in SUCCESSES]
    if not failed:
        return []
    section = Section("failures", "Failures")
    section.explanation = f"All about each, and the commands to run it again: {folder / FAILURES}/KEY."
    head = ("key", "wall", "world, seed", "verdict", "reason")
    section.table = [head, *(_failure(row) for row in failed[:MAX_FAILURES])]
    if len(failed) > MAX_FAILURES:
        section.notes.append(f"The first {MAX_FAILURES} of {len(failed)}.")
    with_log = [row for row in failed if (folder / FAILURES / row["key"] / LOG_FILE).is_file()]
    try:
        section.pictures = [_picture(folder, row) for row in with_log[:MAX_PICTURES]]
    except NoGraphicsError as error:
        section.notes.append(f"No pictures: {error}.")
    return [section]


def _name(row: Row) -> str:
    return str(row.get("wall") or f"{row['walls']} {row['wall_seed']}")


def _failure(row: Row) -> tuple[str, ...]:
    return row["key"], _name(row), f"{row['world']}, {row['seed']}", row["verdict"], row["reason"]


def _picture(folder: Path, row: Row) -> Picture:
    """How a climb ended."""
    from crux_tools.telemetry import read_log

    log = read_log(folder / FAILURES / row["key"] / LOG_FILE)
    with open_stage(log.plan, PICTURE_PX, log.robot_files) as stage:
        last = len(log.time_s) - 1
        stage.show_cycle(log, last)
        return stage.picture(f"{_name(row)}, {row['world']}, {log.time_s[last]:.1f} s: {row['reason']}")


def comparison_section(rows: list[Row], before: list[Row], against: Path) -> Section:
    """Rates of two campaigns beside each other; jobs that are in both, of the same wall, are compared one by one."""
    section = Section("against", f"Against {against}")
    section.explanation = _INTERVALS.format(
        "Newcombe's of the difference of two rates, Bonett and Price's of jobs that are in both"
    )
    pairs = _pairs(rows, before)
    lost = [key for key, (then, now) in pairs.items() if then and not now]
    won = [key for key, (then, now) in pairs.items() if now and not then]
    overall = (
        paired_difference(len(lost), len(won), len(pairs)) if pairs else difference(success(before), success(rows))
    )
    section.verdict = f"Difference: {_points(overall.percent())}"
    section.rows = [
        ("jobs that are in both", str(len(pairs))),
        ("succeeded there alone", _listed(lost)),
        ("succeeded here alone", _listed(won)),
        ("all jobs, as independent samples", _points(difference(success(before), success(rows)).percent())),
    ]
    table: list[tuple[str, ...]] = [("", "", "there", "here", "difference")]
    for column, value in [("", ""), *_groups(rows)]:
        here, there = ([row for row in each if not column or row[column] == value] for each in (rows, before))
        if there:
            change = _points(difference(success(there), success(here)).percent())
            table.append((column or "all", str(value), str(success(there)), str(success(here)), change))
    section.table = table
    return section


def _pairs(rows: list[Row], before: list[Row]) -> dict[str, tuple[bool, bool]]:
    """Success there and here by key."""
    there = {(row["key"], row.get("wall_hash")): row for row in before if row["verdict"] != ERROR}
    both = [(there.get((row["key"], row.get("wall_hash"))), row) for row in rows if row["verdict"] != ERROR]
    return {
        row["key"]: (then["verdict"] in SUCCESSES, row["verdict"] in SUCCESSES)
        for then, row in both
        if then is not None
    }


def _points(percent: str) -> str:
    return percent.replace("%", "points")


def _listed(keys: list[str]) -> str:
    return f"{len(keys)}{': ' if keys else ''}{' '.join(keys[:MAX_PICTURES])}{' …' if len(keys) > MAX_PICTURES else ''}"


def sections_of(folder: Path, against: Path | None) -> list[Section]:
    """Of the page about `folder`. Raises UsageError."""
    rows = campaign_rows(folder)
    sections = campaign_sections(folder, rows)
    if against is not None:
        sections.insert(1, comparison_section(rows, campaign_rows(against), against))
    return sections
