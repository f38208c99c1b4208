"""`crux bench costs` judges by J alone; the planning itself is made up here."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest
from crux_simulation.benchmarks import costs


@pytest.mark.parametrize(("auto", "ok"), [(1.9, True), (2.0, True), (2.1, False), (None, False)])
def test_auto_must_plan_and_be_no_dearer(
    auto: float | None, ok: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def planned(*words: str) -> tuple[dict[str, object], float]:
        cost = auto if words[-1] == "auto" else 2.0
        return ({"ok": False, "error": "none"} if cost is None else {"ok": True, "cost": cost, "gap": 0.1}), 1.0

    monkeypatch.setattr(costs, "crux_json", planned)
    options = argparse.Namespace(count=1, seed=3, task=["walking"], output=tmp_path, json=True)
    assert costs.run(options) == int(not ok)
    result = json.loads(capsys.readouterr().out)
    assert result["ok"] is ok
    assert [pair["seed"] for pair in result["pairs"]] == [3]
    options.json = False
    assert costs.run(options) == int(not ok)
