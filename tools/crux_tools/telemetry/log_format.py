"""The number of a log's format, in its metadata `crux`; logs before format 8 have none."""

from __future__ import annotations

from collections.abc import Mapping

from crux_contracts.channels import LOG_FORMAT


def newer_format(metadata: Mapping[str, str]) -> str:
    """A sentence about a log of a newer format than this crux knows; empty for all others."""
    told = metadata.get("format", "")
    if not told.isdecimal() or int(told) <= LOG_FORMAT:
        return ""
    by = f"written by crux {metadata.get('version', 'unknown')}, commit {metadata.get('commit', 'unknown')}"
    return (
        f"the log is of format {told} ({by}), this crux knows formats up to {LOG_FORMAT}: a newer one shows all of it"
    )
