"""What a command of crux may end with, besides success."""

from __future__ import annotations


class UsageError(Exception):
    """The input or the usage is wrong: exit status 2."""


class WorkFailed(Exception):
    """The input was right, the work did not succeed: exit status 1."""
