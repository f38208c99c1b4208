"""Patience with nodes on a busy machine."""

from __future__ import annotations

import pytest
from crux_tools.can import node_link, update_command

ANSWER_S, RESTART_S, CONFIRM_S = 120.0, 600.0, 600.0


@pytest.fixture(autouse=True)
def nodes_may_take_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a tool waits for a node is no matter of what is tested here."""
    monkeypatch.setattr(node_link, "RESTART_S", RESTART_S)
    monkeypatch.setattr(update_command, "CONFIRM_S", CONFIRM_S)
    monkeypatch.setattr(node_link.NodeLink.__init__, "__defaults__", (ANSWER_S,))
