"""`crux bench routes` judges by plans, J and the ratio of CPU times; the planning itself is made up here."""

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


@pytest.mark.parametrize(
    ("here", "cpu_s", "other", "ok"),
    [
        (PLANNED, 4.0, None, True),
        (UNDECIDED, 60.0, None, False),
        (PLANNED, 4.0, PLANNED, True),
        (PLANNED, 13.0, PLANNED, False),
        (PLANNED | {"cost": 50.2}, 4.0, PLANNED, False),
        (PLANNED | {"cost": 40.0}, 4.0, PLANNED, True),
        (PLANNED, 4.0, UNDECIDED, True),
    ],
    ids=["alone", "undecided", "as good", "slower", "dearer", "cheaper", "the other undecided"],
)
def test_a_route_is_planned_no_dearer_and_no_slower_than_by_the_other(
    here: dict[str, Any],
    cpu_s: float,
    other: dict[str, Any] | None,
    ok: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    checkout = tmp_path / "checkout"
    (checkout / "planner" / "crux_planner").mkdir(parents=True)

    def planned(_module: str, *words: str, limit_s: float, environment: dict[str, str]) -> Measured:
        assert Path(words[1]).read_text(encoding="utf-8").count("friction: 2.2") == 16
        theirs = environment["PYTHONPATH"].startswith(str(checkout / "planner"))
        result, took_s = (other, 10.0) if theirs else (here, cpu_s)
        assert result is not None
        return Measured(result, limit_s, took_s, 100.0)

    monkeypatch.setattr(routes, "measured", planned)
    against = None if other is None else checkout
    options = argparse.Namespace(rungs=[8], seed=3, against=against, output=tmp_path / "out", json=True)
    assert routes.run(options) == int(not ok)
    printed = json.loads(capsys.readouterr().out)
    assert printed["ok"] == ok
    assert printed["cpu_ratio"] == (None if other is None else cpu_s / 10.0)
    assert printed["routes"][0]["holds"] == 16
