"""The channel and fault tables with types. Channel names are constants here: CRUX_PLAN, CRUX_COMMAND, ..."""

from __future__ import annotations

from dataclasses import dataclass

from crux_msgs import tables
from crux_msgs.channel_names import *  # noqa: F403

from . import LIMB_NAMES

EVENT_RATE = -1.0
SUPERVISOR_STATES = tables.ENUMERATIONS["robot_state_t"][0]
"""IDLE, READY, ...: names of robot_state_t.supervisor_state."""


@dataclass(frozen=True)
class Channel:
    """rate_Hz on LCM: EVENT_RATE for messages sent when something happens, 0 for what is only logged. `topic` is that
    of all limbs' messages; in the log those of a `per_limb` channel have a topic for each limb, see `log_topics`."""

    name: str
    type: str
    rate_Hz: float
    writer: str
    logged: bool
    topic: str
    per_limb: bool


@dataclass(frozen=True)
class Schema:
    """An MCAP schema of encoding ros2msg."""

    name: str
    definition: str


@dataclass(frozen=True)
class FaultKind:
    """`to` is the supervisor state that follows; `text` has {value} and {limit} for fault_t's numbers."""

    code: int
    name: str
    to: str
    text: str

    def describe(self, value: float, limit: float) -> str:
        """The text with its numbers."""
        return self.text.format(value=f"{value + 0.0:g}", limit=f"{limit + 0.0:g}")  # -0 is 0


CHANNELS = tuple(Channel(*row) for row in tables.CHANNELS)
BY_NAME = {channel.name: channel for channel in CHANNELS}
BY_TOPIC = {channel.topic: channel for channel in CHANNELS if channel.topic}
_SHARED = {f"/{limb}{channel.topic}": channel.topic for channel in CHANNELS if channel.per_limb for limb in LIMB_NAMES}
LOG_FORMAT = tables.LOG_FORMAT
"""The newest log format that is known here. Logs say theirs from format 8 on."""
SCHEMAS = {name: Schema(*row) for name, row in tables.SCHEMAS.items()}
"""By LCM type, e.g. SCHEMAS["plan_t"]."""
FAULTS = tuple(FaultKind(*row) for row in tables.FAULTS)
FAULT_BY_CODE = {fault.code: fault for fault in FAULTS}


def log_topics(channel: Channel) -> tuple[str, ...]:
    """The channel's topics in a log: one, or one a limb; none when it is not logged."""
    if not channel.per_limb:
        return (channel.topic,) if channel.logged else ()
    return tuple(f"/{limb}{channel.topic}" for limb in LIMB_NAMES)


def shared_topic(topic: str) -> str:
    """The topic of a channel for any of its topics in a log; other topics stay. Before log format 8 the limbs shared
    one.
    """
    return _SHARED.get(topic, topic)
