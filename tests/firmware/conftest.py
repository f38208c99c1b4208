"""Patience with nodes on a busy machine."""

from __future__ import annotations

import pytest
from crux_tools.can import node_link


@pytest.fixture(autouse=True)
def restarts_may_take_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a tool waits for a restarted node is no matter of what is tested here."""
    monkeypatch.setattr(node_link, "RESTART_S", 600.0)
