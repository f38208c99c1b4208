"""tests/sweeps.yaml keeps what is known of other files; the page of the tests says what each file's sweeps show."""

from __future__ import annotations

import datetime
import re
from collections import Counter
from pathlib import Path

import yaml
from crux_tools.paths import ROOT
from sweep_record import RECORD, record


def test_what_ran_is_written_beside_what_is_known(tmp_path: Path) -> None:
    file, first, second = tmp_path / "sweeps.yaml", datetime.date(2026, 1, 2), datetime.date(2026, 2, 3)
    record({"a.py": Counter(passed=2), "b.py": Counter(passed=1)}, first, file)
    record({"b.py": Counter(passed=1, failed=3)}, second, file)
    found = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert found == {"a.py": {"on": first, "passed": 2}, "b.py": {"on": second, "failed": 3, "passed": 1}}


def test_every_file_in_the_record_has_sweeps() -> None:
    for name in yaml.safe_load(RECORD.read_text(encoding="utf-8")):
        assert "mark.sweep" in (ROOT / "tests" / name).read_text(encoding="utf-8"), name


def test_the_page_says_what_each_files_sweeps_show() -> None:
    rows = (ROOT / "tests" / "README.md").read_text(encoding="utf-8").split("| where | shows |")[1].split("\n\n")[0]
    named = [re.findall(r"`([\w/.]+)`", row.split(" | ")[0]) for row in rows.splitlines()]
    shown = {name if "/" in name else f"{Path(names[0]).parent}/{name}" for names in named for name in names}
    marked = [
        path for path in (ROOT / "tests").rglob("test_*.py") if re.search(r"pytest\.mark\.sweep\b", path.read_text())
    ]
    inside = [path.relative_to(ROOT / "tests") for path in marked]
    assert len(inside) > 50
    assert [str(p) for p in inside if not {str(p), *(f"{folder}/" for folder in p.parents)} & shown] == []
