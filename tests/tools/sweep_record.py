"""tests/sweeps.yaml: when the sweeps of each file last ran, and how it went."""

from __future__ import annotations

import datetime
from collections import Counter, defaultdict
from pathlib import Path

import pytest
import yaml

RECORD = Path(__file__).parents[1] / "sweeps.yaml"
HEAD = "# When the sweeps of each file last ran, and how it went; `pytest -m sweep` writes it.\n"
_seen: dict[str, Counter[str]] = defaultdict(Counter)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Notes what became of a test."""
    if report.when == "call" or not report.passed:
        _seen[report.nodeid.split("::")[0].removeprefix("tests/")][report.outcome] += 1


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Writes what is known of the files whose sweeps have all run."""
    options = session.config.option
    part = options.keyword or any("::" in argument for argument in session.config.args)
    if options.markexpr == "sweep" and not part and not hasattr(session.config, "workerinput"):
        record(_seen, datetime.date.today())


def record(seen: dict[str, Counter[str]], day: datetime.date, file: Path = RECORD) -> None:
    """Merges `seen`, outcomes by file, into the record."""
    known = yaml.safe_load(file.read_text(encoding="utf-8")) if file.exists() else {}
    known |= {name: {"on": day, **dict(sorted(outcomes.items()))} for name, outcomes in seen.items()}
    entries = (f"{name}: {yaml.safe_dump(known[name], default_flow_style=True)}" for name in sorted(known))
    file.write_text(HEAD + "".join(entries), encoding="utf-8")
