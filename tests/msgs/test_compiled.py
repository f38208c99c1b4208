"""Compiled parts that are not there."""

from pathlib import Path

import pytest
from crux_contracts import compiled


def test_a_part_that_is_missing_is_named_with_what_builds_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "_FOLDERS", (tmp_path,))
    assert compiled.shared_library("libcrux_checker.so") is None
    with pytest.raises(FileNotFoundError, match=r"make programs.*libcrux_checker\.so"):
        compiled.needed_library("libcrux_checker.so")
