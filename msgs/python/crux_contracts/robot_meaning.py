"""What a robot description means, as a text: the same for any form that says the same. msgs/README.md defines it."""

from __future__ import annotations

import struct
import xml.etree.ElementTree as ET
from collections.abc import Iterator

from .urdf import NUMBER, SPACE
from .yaml_document import Node

FIRST_LINE = "crux-robot-2\n"


def robot_meaning(yaml: Node, urdf: ET.Element) -> str:
    """Canonical text of robot.yaml's top mapping and the URDF's <robot>; its SHA-256 (UTF-8) is the robot's hash."""
    lines = sorted(f"{place}\t{value}\n".encode() for place, value in (*_of_yaml(yaml), *_of_xml(urdf, "")))
    return FIRST_LINE + b"".join(lines).decode()


def _words(text: str) -> str:
    return " ".join(_word(word) for word in SPACE.split(text) if word)


def _word(word: str) -> str:
    return "#" + struct.pack(">d", float(word) + 0.0).hex() if NUMBER.fullmatch(word) else word


def _of_yaml(node: Node) -> Iterator[tuple[str, str]]:
    if isinstance(node.content, dict | list):
        for member in node.content.values() if isinstance(node.content, dict) else node.content:
            yield from _of_yaml(member)
    else:
        yield f"robot.yaml {node.key}", "" if node.content is None else _words(node.source)


def _of_xml(element: ET.Element, parent: str, index: int = 0) -> Iterator[tuple[str, str]]:
    place = f"{parent}/{_local(element.tag)}[{element.get('name', index)}]"
    text = " ".join([element.text or "", *(child.tail or "" for child in element)])
    yield f"urdf {place}", _words(text)
    for name, value in element.attrib.items():
        yield f"urdf {place}@{_local(name)}", _words(value)
    count: dict[str, int] = {}
    for child in element:
        tag = _local(child.tag)
        yield from _of_xml(child, place, count.get(tag, 0))
        count[tag] = count.get(tag, 0) + 1


def _local(name: str) -> str:
    """Without its namespace."""
    return name.rpartition("}")[2]
