"""The `crux` command: HIL bench, upload, operator commands, replay, report and benches."""
