"""`crux report` on a made-up plan and climb."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from crux_contracts.plan_file import write_plan
from crux_tools import cli
from made_up_climb import CYCLE_S, DT_S, SCENARIO_YAML, SWING_KNOTS, Story, made_up_plan
from PIL import Image

STORY = Story()
LOG_SECTIONS = ["summary", "pictures", "gait", "wrenches", "margins", "body", "grasp", "timing", "scenario"]
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
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
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


def test_a_climbs_page_has_everything_and_needs_no_network(log_path: Path, tmp_path: Path) -> None:
    page, _ = _report(log_path, tmp_path)
    assert page.sections == LOG_SECTIONS
    assert all(source.startswith("data:image/") for source in page.sources)
    pictures = [source for source in page.sources if source.startswith("data:image/jpeg")]
    assert len(pictures) == 3  # start, one swing, end
    swing = re.search(r"LF from a to e, (\d\.\d) s", page.words)
    assert swing is not None
    assert float(swing[1]) == pytest.approx(MIDDLE_OF_SWING_S, abs=0.06)
    assert "largest 5.00 mm" in page.words
    assert "LF 1.00 N" in page.words
    assert SCENARIO_YAML in page.words


def test_a_plans_page(plan_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, output = _report(plan_path, tmp_path, "--json")
    assert page.sections == PLAN_SECTIONS
    result = json.loads(capsys.readouterr().out)
    assert result["ok"] is True
    assert result["file"] == str(output)
    assert "body moves50 mm" in page.words
    assert "LF from a to e" in page.words


def test_the_picture_is_a_small_png(log_path: Path, tmp_path: Path) -> None:
    picture = tmp_path / "climb.png"
    _report(log_path, tmp_path, "--picture", str(picture))
    assert picture.stat().st_size < 400_000
    with Image.open(picture) as image:
        assert image.format == "PNG"
        colours = image.convert("RGB").getcolors(1 << 24) or []
        assert len(colours) > 50  # something is to be seen


def test_without_graphics_the_page_says_so(
    log_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from crux_tools.report import pictures, renderer

    class NoRenderer:
        def __init__(self, *_: object) -> None:
            raise renderer.NoGraphicsError("no EGL")

    monkeypatch.setattr(pictures, "Renderer", NoRenderer)
    page, output = _report(log_path, tmp_path)
    assert page.sections == LOG_SECTIONS
    assert "No pictures: this machine has no OpenGL" in page.words
    assert cli.main(["report", str(log_path), "-o", str(output), "--picture", str(tmp_path / "p.png")]) == 1
    assert "no OpenGL" in capsys.readouterr().err
    assert not (tmp_path / "p.png").exists()


def test_a_killed_runtimes_log_gets_a_page_that_says_so(killed_log_path: Path, tmp_path: Path) -> None:
    page, _ = _report(killed_log_path, tmp_path)
    assert page.sections == LOG_SECTIONS
    assert "the log was not closed" in page.words


def test_a_real_time_run_with_a_fault(faulty_log_path: Path, tmp_path: Path) -> None:
    page, _ = _report(faulty_log_path, tmp_path)
    assert "7 body_error: body is 0.07 m off its reference" in page.words
    assert "period" in page.words
    assert "In lockstep" not in page.words


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
