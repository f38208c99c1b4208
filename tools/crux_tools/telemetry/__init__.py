"""Plans and telemetry logs as NumPy arrays, and the figures a climb is judged by."""

from crux_tools.telemetry.channels import Channels, LogError, read_channels
from crux_tools.telemetry.reader import Telemetry, is_log, read_log, telemetry_of

__all__ = ["Channels", "LogError", "Telemetry", "is_log", "read_channels", "read_log", "telemetry_of"]
