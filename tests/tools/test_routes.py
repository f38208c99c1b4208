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


@pytest.mark.parametrize(("last", "ok"), [(PLANNED, True), (UNDECIDED, False)])
def test_every_route_must_be_planned(
    last: dict[str, Any], ok: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def planned(_module: str, *words: str, limit_s: float) -> Measured:
        holds = Path(words[1]).read_text(encoding="utf-8").count("friction: 2.2")
        return Measured(last if holds == 18 else PLANNED, limit_s, 4.0, 100.0)

    monkeypatch.setattr(routes, "measured", planned)
    options = argparse.Namespace(rungs=[8, 9], seed=3, output=tmp_path / "out", json=True)
    assert routes.run(options) == int(not ok)
    printed = json.loads(capsys.readouterr().out)
    assert [(row["holds"], row["ok"]) for row in printed["routes"]] == [(16, True), (18, ok)]
    options.json = False
    assert routes.run(options) == int(not ok)
    assert f"planned within the default limit: {1 + ok} of 2" in capsys.readouterr().err
