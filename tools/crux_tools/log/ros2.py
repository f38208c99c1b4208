"""Standard ROS 2 messages that other tools draw by themselves, in CDR.

A message that is sent often is laid out once, with its strings and the lengths of its lists; then only numbers change,
and thousands of messages are filled at once (`Rows`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from crux_contracts.cdr import ENCAPSULATION

_NUMBERS = {"bool": "<u1", "byte": "<u1", "uint8": "<u1", "int32": "<i4", "uint32": "<u4"}
_NUMBERS |= {"float32": "<f4", "float64": "<f8"}
_XYZ = "float64 x\nfloat64 y\nfloat64 z"
_OWN = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "std_msgs/String": "string data",
    "std_msgs/Float64": "float64 data",
    "std_msgs/ColorRGBA": "float32 r\nfloat32 g\nfloat32 b\nfloat32 a",
    "geometry_msgs/Point": _XYZ,
    "geometry_msgs/Vector3": _XYZ,
    "geometry_msgs/Quaternion": f"{_XYZ}\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform",
    "geometry_msgs/Wrench": "geometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\ngeometry_msgs/Wrench wrench",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
    "sensor_msgs/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    "float64[] effort",
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data",
    "visualization_msgs/UVCoordinate": "float32 u\nfloat32 v",
    "visualization_msgs/MeshFile": "string filename\nuint8[] data",
    "visualization_msgs/Marker": "std_msgs/Header header\nstring ns\nint32 id\nint32 type\nint32 action\n"
    "geometry_msgs/Pose pose\ngeometry_msgs/Vector3 scale\nstd_msgs/ColorRGBA color\n"
    "builtin_interfaces/Duration lifetime\nbool frame_locked\ngeometry_msgs/Point[] points\n"
    "std_msgs/ColorRGBA[] colors\nstring texture_resource\nsensor_msgs/CompressedImage texture\n"
    "visualization_msgs/UVCoordinate[] uv_coordinates\nstring text\nstring mesh_resource\n"
    "visualization_msgs/MeshFile mesh_file\nbool mesh_use_embedded_materials",
    "visualization_msgs/MarkerArray": "visualization_msgs/Marker[] markers",
    "rcl_interfaces/Log": "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\n"
    "string function\nuint32 line",
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": "byte level\nstring name\nstring message\nstring hardware_id\n"
    "diagnostic_msgs/KeyValue[] values",
    "diagnostic_msgs/DiagnosticArray": "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status",
}


def _members(name: str) -> list[tuple[str, bool, str]]:
    """(type, whether a list, member) of a message."""
    pairs = (line.split() for line in _OWN[name].splitlines())
    return [(kind.removesuffix("[]"), kind.endswith("[]"), member) for kind, member in pairs]


def definition(name: str) -> str:
    """The text of encoding ros2msg: the message's own members, then every message in it once."""
    found = [name]
    for each in found:  # grows on the way
        found += [kind for kind, _, _ in _members(each) if kind in _OWN and kind not in found]
    parts = [_OWN[name], *(f"{'=' * 80}\nMSG: {inner}\n{_OWN[inner]}" for inner in dict.fromkeys(found[1:]))]
    return "\n".join(parts) + "\n"


@dataclass
class Layout:
    """A message in CDR, and where its numbers stand: byte and type, by their path, such as transforms.3.transform."""

    data: bytearray = field(default_factory=lambda: bytearray(ENCAPSULATION))
    places: dict[str, tuple[int, np.dtype]] = field(default_factory=dict)

    def _number(self, kind: str, value: Any, path: str) -> None:
        dtype = np.dtype(_NUMBERS[kind])
        self.data += bytes(-(len(self.data) - len(ENCAPSULATION)) % dtype.itemsize)
        while path not in self.places:  # whatever begins with this number is found by its name, too
            self.places[path] = (len(self.data), dtype)
            path = path.rpartition(".")[0]
        self.data += np.array(value, dtype).tobytes()

    def add(self, kind: str, is_list: bool, value: Any, path: str) -> None:
        """Adds a member; None: a number is 0, a text or list is empty."""
        if is_list:
            self._number("uint32", len(value or ()), f"{path}.length")
            for index, element in enumerate(value or ()):
                self.add(kind, False, element, f"{path}.{index}")
        elif kind == "string":
            text = (value or "").encode() + b"\0"
            self._number("uint32", len(text), f"{path}.length")
            self.places[path] = (len(self.data), np.dtype(np.uint8))
            self.data += text
        elif kind in _NUMBERS:
            self._number(kind, 0 if value is None else value, path)
        else:
            for inner, inner_is_list, name in _members(kind):
                self.add(inner, inner_is_list, None if value is None else value.get(name), f"{path}.{name}")


def laid_out(name: str, message: dict[str, Any]) -> Layout:
    """A message of nested dicts and lists; what is left out is 0 or empty."""
    layout = Layout()
    for kind, is_list, member in _members(name):
        layout.add(kind, is_list, message.get(member), member)
    return layout


def encoded(name: str, message: dict[str, Any]) -> bytes:
    """The message in CDR."""
    return bytes(laid_out(name, message).data)


def vector(values: Any, names: str = "xyzw") -> dict[str, float]:
    """A Point, Vector3 or Quaternion of its numbers, in that order; `names`: "rgba" for a colour."""
    return {name: float(value) for name, value in zip(names, values, strict=False)}


def stamp(time_ns: int) -> dict[str, int]:
    """builtin_interfaces/Time."""
    return dict(zip(("sec", "nanosec"), divmod(int(time_ns), 10**9), strict=True))


class Rows:
    """n messages of one layout whose numbers are filled in by columns."""

    def __init__(self, layout: Layout, n: int) -> None:
        self._places = layout.places
        self._bytes = np.tile(np.frombuffer(bytes(layout.data), dtype=np.uint8), (n, 1))

    def put(self, path: str, values: np.ndarray) -> None:
        """Numbers (n, …) of one type, from the one at `path` on; (n, 0) is nothing."""
        at, dtype = self._places[path]
        raw = np.ascontiguousarray(values, dtype=dtype).reshape(len(self._bytes), -1).view(np.uint8)
        self._bytes[:, at : at + raw.shape[1]] = raw

    def put_text(self, path: str, texts: list[str]) -> None:
        """Texts of the length that the layout's own has."""
        self.put(path, np.array([list(text.encode()) for text in texts], dtype=np.uint8))

    def put_stamps(self, paths: list[str], times_ns: np.ndarray) -> None:
        """Times into members of type builtin_interfaces/Time."""
        sec, nanosec = np.divmod(times_ns, 10**9)
        for path in paths:
            self.put(f"{path}.sec", sec)
            self.put(f"{path}.nanosec", nanosec)

    def payloads(self) -> list[bytes]:
        """The messages."""
        return [row.tobytes() for row in self._bytes]
