"""`crux bench routes` counts what is planned; the planning itself is made up here."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pytest
from crux_simulation.benchmarks import routes
from crux_simulation.benchmarks.cold_process import Measured

PLANNED: dict[str, Any] = {"ok": True, "cost": 50.0, "steps": 120}
UNDECIDED: dict[str, Any] = {"ok": False, "undecided": True, "error": "undecided (time limit)"}


def options_of(output: Path, rungs: list[int], *, stream: bool = False) -> argparse.Namespace:
    output.mkdir(exist_ok=True)
    return argparse.Namespace(rungs=rungs, seed=3, output=output, json=True, stream=stream, objective="time")


@pytest.mark.parametrize(("last", "ok"), [(PLANNED, True), (UNDECIDED, False)])
def test_every_route_must_be_planned(
    last: dict[str, Any], ok: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def planned(_module: str, *words: str, limit_s: float) -> Measured:
        holds = Path(words[1]).read_text(encoding="utf-8").count("friction: 2.2")
        return Measured(last if holds == 18 else PLANNED, limit_s, 4.0, 100.0)

    monkeypatch.setattr(routes, "measured", planned)
    options = options_of(tmp_path / "out", [8, 9])
    assert routes.run(options) == int(not ok)
    printed = json.loads(capsys.readouterr().out)
    assert [(row["holds"], row["ok"]) for row in printed["routes"]] == [(16, True), (18, ok)]
    options.json = False
    assert routes.run(options) == int(not ok)
    assert f"planned within the default limit: {1 + ok} of 2" in capsys.readouterr().err


@pytest.mark.parametrize(("power", "peak_MB", "ok"), [(1.0, 200.0, True), (1.3, 200.0, False), (1.0, 1500.0, False)])
def test_routes_in_parts_take_little_memory_and_a_time_that_grows_as_they_do(
    power: float,
    peak_MB: float,
    ok: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    parts = {"ok": True, "parts": [{"cost": 5.0, "steps": 40}, {"cost": 7.0, "steps": 90}]}

    def planned(_module: str, *words: str, limit_s: float) -> Measured:
        assert "--stream" in words
        assert not (Path(words[words.index("-o") + 1]) / "00000.mcap").exists()
        holds = Path(words[1]).read_text(encoding="utf-8").count("friction: 2.2")
        return Measured(parts, limit_s, 0.3 * holds**power, peak_MB)

    monkeypatch.setattr(routes, "measured", planned)
    (tmp_path / "ladder-3-750").mkdir()
    (tmp_path / "ladder-3-750" / "00000.mcap").touch()  # of a run before
    assert routes.run(options_of(tmp_path, [50, 150, 750], stream=True)) == int(not ok)
    printed = json.loads(capsys.readouterr().out)
    assert printed["exponent"] == pytest.approx(power)
    assert printed["routes"][2] == {
        "holds": 1500, "seed": 3, "ok": True, "undecided": None, "cost": 12.0, "steps": 130, "error": None,
        "cpu_s": round(0.3 * 1500**power, 2), "peak_MB": peak_MB,
    }  # fmt: skip
