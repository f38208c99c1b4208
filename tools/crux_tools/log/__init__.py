"""`crux log`: logs for other tools, listed, cut, merged, recovered and played."""
