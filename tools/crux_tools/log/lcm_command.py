"""`crux log lcm`: a log played on LCM as its runtime said it, for lcm-spy and what else listens there."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from crux_tools.arguments import positive, taught
from crux_tools.errors import UsageError
from crux_tools.log.edit_commands import add_span
from crux_tools.output import add_json_option, note, print_json, progress

NS = 10**9
RATE_HZ = 50  # at most, of every channel: as the runtime's own
LISTEN_S = 0.3
# An operator would take these for his runtime's.
KEPT_BACK = {"/acknowledgement"}
_DESCRIPTION = """Plays a log on LCM at the chosen speed, so that lcm-spy and other listeners show it: every channel of
msgs/channels.yaml that is in the log, at most at 50 Hz. Commands and acknowledgements are left out, so playing a log
moves no robot and answers no operator. Refused while a runtime uses the same address."""
_EXAMPLES = (
    "crux log lcm out/climb.mcap --speed 2",
    "crux log lcm out/climb.mcap --from 40 --to 45 --speed 0.1",
)


@dataclass(frozen=True)
class Played:
    """A message to be sent."""

    time_ns: int
    channel: str
    make: Callable[[], bytes]


def add_lcm(actions: Any) -> None:
    """Adds the parser of `crux log lcm`."""
    from crux_tools.operator_link import DEFAULT_URL

    parser = actions.add_parser("lcm", help="play a log on LCM", **taught(_DESCRIPTION, *_EXAMPLES))
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="telemetry of a climb")
    parser.add_argument("--speed", type=positive, default=1.0, metavar="X", help="times real time (default: 1)")
    add_span(parser)
    parser.add_argument("--lcm", default=DEFAULT_URL, metavar="URL", help="(default: %(default)s)")
    add_json_option(parser)
    parser.set_defaults(action=run_lcm)


def messages(log: Path, from_s: float, to_s: float) -> list[Played]:
    """What is to be sent between two log times, in the order of time. Raises LogError."""
    import numpy as np
    from crux_contracts.channels import BY_TOPIC

    from crux_tools.telemetry.channels import fits_definition, read_payloads

    topics = {topic for topic, channel in BY_TOPIC.items() if channel.writer != "tools"} - KEPT_BACK
    read = read_payloads(log, topics)
    found = []
    for topic, payloads in read.payloads.items():
        with fits_definition(log, topic):
            encode = _encoder(read.types[topic], read.definitions[topic], BY_TOPIC[topic].type)
        times = np.array(read.times_ns[topic], dtype=np.int64)
        bins = times * RATE_HZ // NS
        first: dict[int, int] = {}
        order = np.argsort(times, kind="stable")
        for i in order.tolist():
            due = times[i] == first.setdefault(int(bins[i]), int(times[i]))
            if due and from_s <= times[i] / NS <= to_s:
                found.append(
                    Played(int(times[i]), BY_TOPIC[topic].name, partial(_encoded, log, topic, encode, payloads[i]))
                )
    return sorted(found, key=lambda each: each.time_ns)


def _encoded(log: Path, topic: str, encode: Callable[[bytes], bytes], payload: bytes) -> bytes:
    from crux_tools.telemetry.channels import fits_definition

    with fits_definition(log, topic):
        return encode(payload)


def _encoder(schema_name: str, definition: str, type_name: str) -> Callable[[bytes], bytes]:
    """From a log's CDR to LCM's bytes; fields that an older log does not have are 0."""
    from mcap.records import Schema

    from crux_tools.telemetry.definitions import decoder_of

    decode = decoder_of(Schema(1, definition.encode(), "ros2msg", schema_name))
    assert decode is not None
    return lambda payload: bytes(_as_lcm(type_name, decode(payload)).encode())


def _as_lcm(type_name: str, message: Any) -> Any:
    import crux_msgs
    from crux_contracts import N_LIMBS
    from crux_contracts.robot_bounds import JOINTS
    from crux_msgs.tables import MEMBERS

    from crux_tools.telemetry.slots import OF_MESSAGES, for_messages

    made = getattr(crux_msgs, type_name)()
    for name, kind, dimension in MEMBERS[type_name]:
        if not hasattr(message, name):
            continue
        value = getattr(message, name)
        if kind in MEMBERS:
            value = _as_lcm(kind, value) if dimension is None else [_as_lcm(kind, each) for each in value]
        elif (dimension,) == OF_MESSAGES and len(value) == N_LIMBS * JOINTS:
            value = for_messages(value)
        setattr(made, name, value if dimension is None else list(value))
    return made


def play(found: list[Played], publish: Callable[[str, bytes], None], speed: float, at: Callable[[float], None]) -> None:
    """Sends each when its time has come, counted from the first; `at` is told the log time [s]."""
    if not found:
        return
    begin, begin_ns = time.monotonic(), found[0].time_ns
    for each in found:
        left_s = begin + (each.time_ns - begin_ns) / NS / speed - time.monotonic()
        if left_s > 0:
            at(each.time_ns / NS)
            time.sleep(left_s)
        publish(each.channel, each.make())


def _is_somebody_there(link: Any) -> bool:
    """Whether a runtime tells its state at the address."""
    from crux_contracts import channels

    return link.receive(LISTEN_S, lambda channel, _data: channel == channels.CRUX_ROBOT_STATE) is not None


def run_lcm(options: argparse.Namespace) -> int:
    """Exit status 0 when it was played to its end."""
    from crux_tools.lcm_socket import LcmSocket

    found = messages(options.log, options.from_s, options.to_s)
    if not found:
        raise UsageError(f"{options.log}: nothing to play in it from {options.from_s:g} to {options.to_s:g} s")
    link = LcmSocket(options.lcm)
    if _is_somebody_there(link):
        raise UsageError(f"--lcm {options.lcm}: a runtime talks there, and the log would mix with it; give another one")
    note(f"playing on {options.lcm}; lcm-spy shows it (Ctrl-C ends it)")
    begin_s = found[0].time_ns / NS
    with progress("playing", found[-1].time_ns / NS - begin_s) as bar:
        play(found, link.publish, options.speed, lambda time_s: bar.at(time_s - begin_s))
    if options.json:
        print_json({"ok": True, "messages": len(found), "channels": sorted({each.channel for each in found})})
    else:
        note(f"{len(found)} messages played")
    return 0
