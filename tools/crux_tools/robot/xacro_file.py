"""A URDF that is written as xacro, expanded by the package xacro where that is installed."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from crux_tools.errors import UsageError

MACROS = re.compile(rb"<xacro:")
COMMENTS = re.compile(rb"<!--.*?-->", re.DOTALL)
ABSENT = "package://"  # before the name of a package that is not there: meshes in it do not hinder


def is_xacro(path: Path, text: bytes) -> bool:
    """By its name, or a macro outside comments."""
    return path.suffix == ".xacro" or MACROS.search(COMMENTS.sub(b"", text)) is not None


def arguments_of(words: Sequence[str]) -> dict[str, str]:
    """Of words NAME:=VALUE. Raises UsageError."""
    wrong = [word for word in words if not re.fullmatch(r"\w+:=.*", word)]
    if wrong:
        raise UsageError(f"--xacro {' '.join(wrong)}: expected NAME:=VALUE")
    return dict(word.split(":=", 1) for word in words)


def expanded(path: Path, text: bytes, arguments: dict[str, str]) -> bytes:
    """The URDF of a xacro file with its arguments. Raises UsageError with all arguments that are missing, or what xacro
    says.
    """
    try:
        import xacro
        from xacro import substitution_args
    except ImportError:
        by_hand = "or make a URDF of it elsewhere: `xacro FILE -o robot.urdf`"
        raise UsageError(f"{path}: is xacro: install its package, `pip install xacro`, {by_hand}") from None
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise UsageError(f"{path}: document types and entities are not allowed")
    xacro.verbosity = 0  # it prints where it was
    before, substitution_args._eval_find = substitution_args._eval_find, lambda name: _package(path, name)
    try:
        document = xacro.process_file(str(path), mappings=dict(arguments))
    except Exception as error:  # whatever the expressions of a file raise
        raise UsageError(f"{path}: {_told(error, text, arguments)}") from None
    finally:
        substitution_args._eval_find = before
    return bytes(document.toxml(encoding="utf-8"))


def _package(path: Path, name: str) -> str:
    """The folder of a ROS package: one above the file that package.xml names so or that is called so, or one beside
    these.
    """
    for above in path.resolve().parents:
        for folder in (above, above / name):
            if (folder.name == name and folder.is_dir()) or _named(folder / "package.xml") == name:
                return str(folder)
    return ABSENT + name


def _named(file: Path) -> str:
    try:
        return (ET.parse(file).findtext("name") or "").strip()
    except (OSError, ET.ParseError):
        return ""


def _told(error: Exception, text: bytes, arguments: dict[str, str]) -> str:
    """What went wrong, and what to change."""
    said = " ".join(str(error).split()) or type(error).__name__
    absent = re.search(rf"{ABSENT}([\w-]+)", said)
    if absent:
        return f"no package {absent[1]}: expected a folder of this name beside the file or above it ({said})"
    asked = {name.decode() for name in re.findall(rb"\$\(arg (\w+)\)", text)}
    given = {name.decode() for name in re.findall(rb"<xacro:arg\s[^>]*name=\"(\w+)\"[^>]*default=", text)}
    missing = sorted(asked - given - set(arguments))
    if missing and "arg" in said.lower():
        return f"arguments are missing: --xacro {' '.join(f'{name}:=VALUE' for name in missing)}"
    return f"xacro does not expand it: {said}"
