"""The `crux` command and what an operator installs: commands to a runtime, logs, reports, the viewer."""
