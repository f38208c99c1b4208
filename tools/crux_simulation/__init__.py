"""Simulated climbs, campaigns and benches; found by `crux` only through its table of commands."""
