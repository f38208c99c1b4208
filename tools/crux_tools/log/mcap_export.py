"""A log as Foxglove, Lichtblick, rviz and PlotJuggler understand it: an MCAP file with standard ROS 2 messages.

All that is in the log is in it, too, each limb on topics of its own whatever the log's format: tools tell curves apart
by their topic, and four limbs on one make a zigzag of it.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import CHANNELS
from mcap.writer import CompressionType, Writer

from crux_tools.log.diagnostics import diagnostics
from crux_tools.log.markers import force_markers, wall_markers
from crux_tools.log.ros2 import Rows, definition, encoded, laid_out, stamp
from crux_tools.log.seen import Seen, contact_frame
from crux_tools.telemetry.cdr_table import fixed_dtype
from crux_tools.telemetry.channels import Payloads

BLOCK_ROWS = 1000  # derived at a time
OF_A_LIMB = {channel.topic for channel in CHANNELS if channel.per_limb}
LATCHED = {"/plan", "/robot_description", "/tf_static", "/markers/wall"}
_QOS = """- history: 1
  depth: 1
  reliability: 1
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: 1
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false
"""
Message = tuple[int, str, bytes]  # time [ns], topic, CDR
DERIVED = {  # message of every topic that is not in the log itself; {limb}: one a limb
    "/robot_description": "std_msgs/String",
    "/tf": "tf2_msgs/TFMessage",
    "/tf_static": "tf2_msgs/TFMessage",
    "/joint_states": "sensor_msgs/JointState",
    "/{limb}/wrench": "geometry_msgs/WrenchStamped",
    "/{limb}/wrench_reference": "geometry_msgs/WrenchStamped",
    "/{limb}/margin": "std_msgs/Float64",
    "/markers/wall": "visualization_msgs/MarkerArray",
    "/markers/forces": "visualization_msgs/MarkerArray",
    "/rosout": "rcl_interfaces/Log",
    "/diagnostics": "diagnostic_msgs/DiagnosticArray",
}


def derived_topics() -> dict[str, str]:
    """Topics by their name, with their message."""
    return {
        topic.format(limb=limb): message
        for topic, message in DERIVED.items()
        for limb in (LIMB_NAMES if "{limb}" in topic else LIMB_NAMES[:1])
    }


def write_mcap(path: Path, seen: Seen, payloads: Payloads) -> int:
    """Writes the file; returns the number of messages. Stamps are the times of their messages."""
    own = {topic: message for topic, message in derived_topics().items() if topic not in payloads.payloads}
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4)
        writer.start(profile="ros2", library="crux log export")
        writer.add_metadata("crux", {**payloads.metadata, "exported_from": seen.log.path.name})
        for name, data in payloads.attachments.items():
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
        channels = {
            topic: _channel(writer, topic, message.replace("/", "/msg/"), definition(message))
            for topic, message in own.items()
        }
        for topic, names in _split(payloads).items():
            for name in names:
                channels[name] = _channel(writer, name, payloads.types[topic], payloads.definitions[topic])
        streams = [_statics(seen, payloads), _events(seen), diagnostics(seen), _rows(seen)]
        streams += [_logged(payloads, topic, seen) for topic in payloads.payloads]
        count = 0
        for time_ns, topic, payload in heapq.merge(*streams, key=lambda message: message[0]):
            writer.add_message(channels[topic], time_ns, payload, time_ns, count)
            count += 1
        writer.finish()  # type: ignore[no-untyped-call]
    return count


def _channel(writer: Writer, topic: str, kind: str, text: str) -> int:
    schema = writer.register_schema(kind, "ros2msg", text.encode())
    qos = _QOS.format(durability=1 if topic in LATCHED else 2)
    return int(writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": qos}))


def _limb_place(payloads: Payloads, topic: str) -> int | None:
    """The byte of a message that tells its limb; None where all limbs share a message."""
    dtype = fixed_dtype(payloads.definitions[topic]) if topic in OF_A_LIMB else None
    return None if dtype is None or dtype.fields is None else int(dtype.fields["limb"][1])


def _split(payloads: Payloads) -> dict[str, list[str]]:
    """The topics that a topic of the log becomes."""
    split = {topic: _limb_place(payloads, topic) is not None for topic in payloads.definitions}
    return {topic: [f"/{limb}{topic}" for limb in LIMB_NAMES] if many else [topic] for topic, many in split.items()}


def _logged(payloads: Payloads, topic: str, seen: Seen) -> Iterator[Message]:
    place = _limb_place(payloads, topic)
    times = seen.clock(np.array(payloads.times_ns[topic], dtype=np.int64)).tolist()
    for time_ns, payload in zip(times, payloads.payloads[topic], strict=True):
        if place is None:
            yield time_ns, topic, payload
        elif payload[place] < len(LIMB_NAMES):
            yield time_ns, f"/{LIMB_NAMES[payload[place]]}{topic}", payload


def _statics(seen: Seen, payloads: Payloads) -> Iterator[Message]:
    """What stands for the whole log, before all else."""
    first = min(times[0] for times in payloads.times_ns.values() if times)
    begin = int(seen.clock(np.array([first]))[0])
    text = seen.robot.urdf_path.read_text(encoding="utf-8")
    yield begin, "/robot_description", encoded("std_msgs/String", {"data": text})
    yield begin, "/tf_static", _transforms(seen.fixed, seen.fixed_at[None], np.array([begin]))[0]
    if seen.log.plan is not None:
        yield begin, "/markers/wall", wall_markers(seen.log.plan)


def _events(seen: Seen) -> Iterator[Message]:
    for event in seen.events:
        message = {"stamp": stamp(event.time_ns), "level": event.level, "name": "crux", "msg": event.text}
        yield event.time_ns, "/rosout", encoded("rcl_interfaces/Log", message)


def _transforms(frames: list[tuple[str, str]], at: np.ndarray, times_ns: np.ndarray) -> list[bytes]:
    """TFMessages of transforms (n, frames, 7)."""
    message = {"transforms": [{"header": {"frame_id": parent}, "child_frame_id": child} for parent, child in frames]}
    rows = Rows(laid_out("tf2_msgs/TFMessage", message), len(at))
    for i in range(len(frames)):
        rows.put(f"transforms.{i}.transform", at[:, i])
    rows.put_stamps([f"transforms.{i}.header.stamp" for i in range(len(frames))], times_ns)
    return rows.payloads()


def _joint_states(seen: Seen) -> list[bytes]:
    zeros = [0.0] * len(seen.joints)
    message = {"name": seen.joints, "position": zeros, "velocity": zeros, "effort": zeros}
    rows = Rows(laid_out("sensor_msgs/JointState", message), len(seen.rows))
    for i, name in enumerate(("position", "velocity", "effort")):
        rows.put(f"{name}.0", seen.joint_state[:, :, i])
    rows.put_stamps(["header.stamp"], seen.times_ns)
    return rows.payloads()


def _wrenches(seen: Seen, limb: int, wrench: np.ndarray) -> list[bytes]:
    header = {"header": {"frame_id": contact_frame(LIMB_NAMES[limb])}}
    rows = Rows(laid_out("geometry_msgs/WrenchStamped", header), len(seen.rows))
    rows.put("wrench.force", wrench[:, limb])
    rows.put_stamps(["header.stamp"], seen.times_ns)
    return rows.payloads()


def _margins(seen: Seen, limb: int) -> list[bytes]:
    rows = Rows(laid_out("std_msgs/Float64", {}), len(seen.rows))
    rows.put("data", seen.margin_n[:, limb])
    return rows.payloads()


def _rows(whole: Seen) -> Iterator[Message]:
    """Everything that comes at the rate of `whole`."""
    for first in range(0, len(whole.rows), BLOCK_ROWS):
        seen = whole.block(first, first + BLOCK_ROWS)
        columns = {
            "/tf": _transforms(seen.moving, seen.moving_at, seen.times_ns),
            "/joint_states": _joint_states(seen),
            "/markers/forces": force_markers(seen),
        }
        measured, reference = seen.wrench(""), seen.wrench("_reference")
        for limb, name in enumerate(LIMB_NAMES):
            columns[f"/{name}/wrench"] = _wrenches(seen, limb, measured)
            columns[f"/{name}/wrench_reference"] = _wrenches(seen, limb, reference)
            columns[f"/{name}/margin"] = _margins(seen, limb)
        for row, time_ns in enumerate(seen.times_ns.tolist()):
            yield from ((time_ns, topic, payloads[row]) for topic, payloads in columns.items())
