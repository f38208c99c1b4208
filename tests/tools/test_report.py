"""`crux report` on a made-up plan and climb."""

from __future__ import annotations

import json
import math
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import made_up_climb
import numpy as np
import pytest
from crux_contracts import cdr
from crux_contracts.motors import joint_continuous_torque_Nm
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_msgs import truth_verdict_t
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.judge import Tracking, Verdict
from crux_simulation.sim.loop import Ending, Outcome
from crux_tools import cli
from crux_tools.report import figures
from crux_tools.report.command import write_report
from crux_tools.report.joints import heat_share
from crux_tools.report.page import STYLE, page
from crux_tools.telemetry.append import Series, append
from crux_tools.telemetry.margins import planned_margin_n
from made_up_climb import (
    CYCLE_S,
    DT_S,
    ROUGHER,
    SCENARIO_YAML,
    SLOPE_RAD,
    SWING_KNOTS,
    WEIGHT_N,
    Story,
    made_up_plan,
    write_log,
)
from PIL import Image

STORY = Story()
LOG_SECTIONS = [
    "verdict", "summary", "pictures", "gait", "wrenches", "margins", "body", "grasp", "joints", "timing", "scenario",
]  # fmt: skip
PLAN_SECTIONS = ["summary", "pictures", "gait", "wrenches", "margins", "scenario"]
MAX_BYTES = 5_000_000
SWING_S = (SWING_KNOTS[1] + 1 - SWING_KNOTS[0]) * DT_S + STORY.wait_cycles * CYCLE_S
MIDDLE_OF_SWING_S = STORY.ready_cycles * CYCLE_S + SWING_KNOTS[0] * DT_S + SWING_S / 2


class Page(HTMLParser):
    """What a test wants to know of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sections: list[str] = []
        self.sources: list[str] = []
        self.words = ""
        self.viewport: str | None = None
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag == "meta" and values.get("name") == "viewport":
            self.viewport = values["content"]
        if tag == "section":
            self.sections.append(values["id"] or "")
        for key in ("src", "href"):
            if key in values:
                self.sources.append(values[key] or "")

    def handle_data(self, data: str) -> None:
        self.words += data


@pytest.fixture(scope="module")
def plan_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "plan.mcap"
    write_plan(path, made_up_plan())
    return path


def _report(source: Path, folder: Path, *more: str) -> tuple[Page, Path]:
    output = folder / "report.html"
    assert cli.main(["report", str(source), "-o", str(output), *more]) == 0
    assert output.stat().st_size < MAX_BYTES
    return Page(output.read_text(encoding="utf-8")), output


@pytest.mark.usefixtures("small_pictures")
def test_a_climbs_page_has_everything_and_needs_no_network(log_path: Path, tmp_path: Path) -> None:
    page, _ = _report(log_path, tmp_path)
    assert page.sections == LOG_SECTIONS
    assert page.viewport == "width=device-width, initial-scale=1"
    assert all(source.startswith("data:image/") for source in page.sources)
    pictures = [source for source in page.sources if source.startswith("data:image/jpeg")]
    assert len(pictures) == 3  # start, one swing, end
    swing = re.search(r"LF from a to e, (\d\.\d) s", page.words)
    assert swing is not None
    assert float(swing[1]) == pytest.approx(MIDDLE_OF_SWING_S, abs=0.06)
    assert "largest 5.00 mm" in page.words
    assert "LF 1.00 N" in page.words
    assert SCENARIO_YAML in page.words


@pytest.mark.usefixtures("undrawn", "small_pictures")
def test_a_plans_page(plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, output = _report(plan_path, tmp_path, "--json")
    assert page.sections == PLAN_SECTIONS
    result = json.loads(capsys.readouterr().out)
    assert result["ok"] is True
    assert result["file"] == str(output)
    assert "body moves50 mm" in page.words
    least = float(np.nanmin(planned_margin_n(made_up_plan())))
    assert _told(page, "smallest margin of a finger with the plan's squeeze").startswith(f"{least:.2f} N")
    assert "LF from a to e" in page.words


def _told(page: Page, what: str) -> str:
    """The verdict, or what stands in a table behind `what`."""
    found = re.search(rf"{re.escape(what)}(.*)", page.words)
    assert found is not None, what
    return found[1]


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_the_page_begins_with_what_the_log_alone_can_tell(
    log_path: Path, faulty_log_path: Path, tmp_path: Path
) -> None:
    page, _ = _report(log_path, tmp_path)
    verdict = page.words[page.words.index("Verdict") :]
    assert verdict.startswith(
        "VerdictPlan completed, by the log alone: 5.0 mm and 0.0 deg off the goal (10 mm and 3 deg allowed) by the "
        "runtime's own estimate, no fault, least margin "
    )
    assert "a log does not tell slips and falls" in verdict
    assert page.words.count("not recorded") == 4  # start, host, seed and command: this log's runtime wrote none
    page, _ = _report(faulty_log_path, tmp_path)
    assert "fault 7 body_error, least margin" in _told(page, "Verdict")


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_the_page_begins_with_the_judges_verdict_where_there_is_one(tmp_path: Path) -> None:
    log = tmp_path / "climb.mcap"
    recorded = {
        "started_utc": "2026-11-22T04:33:54Z", "host": "wall", "commit": "997d69b", "seed": "7",
        "crux_command_line": "crux climb p.mcap",
    }  # fmt: skip
    write_log(log, Story(metadata={"command_line": "crux-runtime --pace bus", **recorded}))
    verdict = Verdict(
        reached_goal=False, fell=True, fall_reason="the body was off its path", lost_grips={"LF": 3.1}, slips=2,
        largest_slip_m=0.0066, goal_error_m=0.045, goal_error_rad=0.1, link_contact_force_n=12.3,
    )  # fmt: skip
    result = ClimbResult(
        Outcome(Ending.COMPLETE, 400, 1.0, 0), verdict, Tracking(), 1.0, 0, "it fell", log, log_complete=False
    )
    pages = [_written(log, tmp_path / "handed.html", result.as_message())]
    append(log, [Series("/truth/verdict", [4_000_000_000], [cdr.encode(result.as_message())])])
    pages.append(_written(log, tmp_path / "later.html"))  # the log alone
    told, later = (_told(Page(page), "Verdict") for page in pages)
    assert told == later
    assert told.startswith(
        "Failed: 45.0 mm and 5.7 deg off the goal (10 mm and 3 deg allowed), 2 slips (largest 6.60 mm), a fall (the "
        "body was off its path), links press on wall or holds with up to 12 N, log incomplete, no fault, least margin "
    )
    for fact in recorded.values():
        assert fact in told
    assert "not recorded" not in told


def _written(log: Path, output: Path, verdict: truth_verdict_t | None = None) -> str:
    write_report(log, output, verdict=verdict)
    return output.read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_a_squeeze_too_small_for_one_cycle_is_in_the_smallest_margin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "MAX_POINTS", 50)  # a log with many more cycles than points on a plot
    log = tmp_path / "climb.mcap"
    usual, slack = [], 12.0
    for story in (Story(), Story(slack=(STORY.ready_cycles + 17, 1, slack))):
        write_log(log, story)
        page, _ = _report(log, tmp_path)
        usual.append(float(_told(page, "smallest margin of a finger with the squeeze the robot applies").split()[0]))
    up, off = WEIGHT_N * math.sin(SLOPE_RAD) / 8, WEIGHT_N * math.cos(SLOPE_RAD) / 8
    assert usual[1] == pytest.approx(ROUGHER * (slack - up) - (off - 5.0), abs=0.01)  # spines bear 5 N
    assert usual[1] < usual[0] - 20


def test_a_plot_shows_the_least_and_the_largest_of_each_interval(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "MAX_POINTS", 100)
    values = np.zeros((9973, 2))
    values[1234, 0], values[7001, 1] = 5.0, -7.0
    values[:50] = np.nan
    time, drawn = figures.envelope(np.arange(9973) * 0.002, values)
    assert len(time) == len(drawn) == 100
    assert (np.diff(time) >= 0).all()
    assert np.nanmax(drawn, axis=0).tolist() == [5.0, 0.0]
    assert np.nanmin(drawn, axis=0).tolist() == [0.0, -7.0]
    assert time[np.nanargmax(drawn[:, 0])] == pytest.approx(1234 * 0.002, abs=9973 * 0.002 / 50)


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_joint_torques_stand_against_their_limits(tmp_path: Path) -> None:
    robot = load_robot("scaler")
    torque = [0.0] * 24
    torque[0], torque[7] = 4.1, -12.5  # LF joint1, RF joint2
    log = tmp_path / "climb.mcap"
    write_log(log, Story(joint_torque_nm=tuple(torque)))
    page, _ = _report(log, tmp_path)
    limit = joint_continuous_torque_Nm(robot.motor)
    assert _told(page, "LF joint1peak").startswith(f" 4.1 of 12.0 Nm, RMS 4.1 of {limit:.1f} Nm, heat at most ")
    assert "LF joint1 4.1 of 2.4 Nm" in _told(page, "the mean load that makers of such servos advise")
    assert _told(page, "Peak torque beyond the joint's effort").startswith(": RF joint2 12.5 of 12.0 Nm.")
    assert _told(page, "RMS torque beyond what the winding bears for good").startswith(": RF joint2 12.5 of 8.1 Nm.")


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_limits_are_those_of_the_description_in_the_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path(shutil.copytree(load_robot("scaler").folder, tmp_path / "scaler"))
    described = (folder / "robot.yaml").read_text(encoding="utf-8")
    assert "continuous_current_A: 5.0" in described
    changed = described.replace("continuous_current_A: 5.0", "continuous_current_A: 4.0")
    (folder / "robot.yaml").write_text(changed, encoding="utf-8")
    monkeypatch.setattr(made_up_climb, "load_robot", lambda _: load_robot(folder))
    log = tmp_path / "climb.mcap"
    write_log(log, Story())
    page, _ = _report(log, tmp_path)
    limit = 4.0 / 5.0 * joint_continuous_torque_Nm(load_robot("scaler").motor)
    assert _told(page, "LF joint1peak").startswith(f" 0.0 of 12.0 Nm, RMS 0.0 of {limit:.1f} Nm")


def test_heat_follows_the_square_of_the_torque() -> None:
    heat = heat_share(np.full((3000, 1), 2.0), np.array([2.0]), heating_time_s=3.0, dt_s=0.002)
    assert heat[1499, 0] == pytest.approx(1 - math.exp(-1), rel=1e-9)  # after 3 s of 6


@pytest.mark.usefixtures("undrawn", "small_pictures")
def test_the_picture_is_a_small_png(log_path: Path, tmp_path: Path) -> None:
    picture = tmp_path / "climb.png"
    _report(log_path, tmp_path, "--picture", str(picture))
    assert picture.stat().st_size < 400_000
    with Image.open(picture) as image:
        assert image.format == "PNG"
        colours = image.convert("RGB").getcolors(1 << 24) or []
        assert len(colours) > 50  # something is to be seen


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_without_graphics_the_page_says_so(log_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, output = _report(log_path, tmp_path)
    assert page.sections == LOG_SECTIONS
    assert "No pictures: this machine has no OpenGL to render with (no EGL); on Debian: apt-get install" in page.words
    assert cli.main(["report", str(log_path), "-o", str(output), "--picture", str(tmp_path / "p.png")]) == 1
    assert "no OpenGL" in capsys.readouterr().err
    assert not (tmp_path / "p.png").exists()


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_a_killed_runtimes_log_gets_a_page_that_says_so(killed_log_path: Path, tmp_path: Path) -> None:
    page, _ = _report(killed_log_path, tmp_path)
    assert page.sections == LOG_SECTIONS
    assert "the log was not closed" in page.words


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_a_real_time_run_with_a_fault(faulty_log_path: Path, tmp_path: Path) -> None:
    page, _ = _report(faulty_log_path, tmp_path)
    assert "7 body_error: body is 0.07 m off its reference" in page.words
    assert "period" in page.words
    assert "In lockstep" not in page.words


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_words_from_outside_are_escaped(tmp_path: Path) -> None:
    plan = made_up_plan()
    plan.scenario_name = "<script>alert(1)</script>"
    path = tmp_path / "plan.mcap"
    write_plan(path, plan)
    _, output = _report(path, tmp_path)
    assert not re.search("<script", output.read_text(encoding="utf-8"))


def test_what_is_neither_plan_nor_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "notes.txt"
    source.write_text("not a log")
    output = tmp_path / "report.html"
    assert cli.main(["report", str(source), "-o", str(output)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(source) in error
    assert not output.exists()


def test_an_output_that_cannot_be_written(log_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["report", str(log_path), "-o", "/proc/report.html"]) == 2
    assert "/proc" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
def test_two_logs_are_compared(log_path: Path, faulty_log_path: Path, tmp_path: Path) -> None:
    output = tmp_path / "report.html"
    assert cli.main(["report", str(log_path), str(faulty_log_path), "-o", str(output)]) == 0
    page = Page(output.read_text(encoding="utf-8"))
    assert page.sections == ["verdict", "differences", "course", "alike"]
    differs = page.words[page.words.index("What differs") : page.words.index("Body and margins")]
    assert re.search(r"faultsnone2\.000 s: 7 body_error", differs)
    assert "duration" not in differs
    assert re.search(r"duration3\.80 s", page.words[page.words.index("What is the same") :])


def test_two_logs_with_what_is_not_of_two_logs_are_refused(
    log_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["report", str(log_path), str(log_path), "-o", str(tmp_path / "page.html")]
    assert cli.main([*words, "--picture", str(tmp_path / "p.png")]) == 2
    assert "--picture: not with two logs" in capsys.readouterr().err


def test_every_colour_of_the_page_has_a_light_and_a_dark_value() -> None:
    light, dark = re.findall(r":root \{([^}]*--[^}]*)\}", STYLE)
    used = set(re.findall(r"var\((--\w+)\)", STYLE))
    assert used == set(re.findall(r"(--\w+):", light)) == set(re.findall(r"(--\w+):", dark))


def test_a_page_is_text_whatever_a_campaigns_rows_hold() -> None:
    assert "<title>?</title>" in page("\ud800", "lead", []).encode().decode()
