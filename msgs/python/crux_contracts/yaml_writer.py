"""A document made in Python, NumPy's numbers and arrays in it, as the YAML that `yaml_document` reads."""

from __future__ import annotations

from collections.abc import Mapping

import yaml

from .yaml_document import MAX_DEPTH, DocumentError, Plain, Problem, resolve_scalar


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # type: ignore[misc]
    def ignore_aliases(self, _data: object) -> bool:
        """A list that stands in several places is written out in each: readers refuse aliases."""
        return True


def _text(dumper: _Dumper, text: str) -> yaml.Node:
    """Quoted where YAML 1.2 would read another thing than text, such as 1e3, which YAML 1.1 takes for text."""
    style = None if isinstance(resolve_scalar(text, True), str) else '"'
    node: yaml.Node = dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)
    return node


_Dumper.add_representer(str, _text)


def as_yaml(content: Mapping[str, object], path: str) -> str:
    """The mapping as a YAML document. Values are texts, numbers, truth values, None, lists, tuples, mappings, and NumPy
    scalars and arrays. Raises DocumentError, which names `path` and the key, for any other.
    """
    try:
        text: str = yaml.dump(_plain(content, "", path), Dumper=_Dumper, sort_keys=False)
    except ValueError as error:  # half a character, or an integer of thousands of digits
        raise DocumentError(path, [Problem("", "", f"cannot be written as YAML: {error}")]) from None
    return text


def _plain(value: object, key: str, path: str, depth: int = 0) -> Plain:
    if depth > MAX_DEPTH:
        raise DocumentError(path, [Problem(key, "", f"nested deeper than {MAX_DEPTH} levels")])
    numbers = getattr(value, "tolist", None)  # of an array or a number of NumPy's
    if callable(numbers):
        value = numbers()
    if isinstance(value, Mapping):
        return {
            _key(each, key, path): _plain(value[each], f"{key}.{each}" if key else f"{each}", path, depth + 1)
            for each in value
        }
    if isinstance(value, list | tuple):
        return [_plain(each, f"{key}[{i}]", path, depth + 1) for i, each in enumerate(value)]
    for kind in (bool, int, float, str):
        if isinstance(value, kind):
            return kind(value)
    if value is None:
        return None
    expected = "expected a text, a number, true or false, a list, an array or a mapping"
    raise DocumentError(path, [Problem(key, f"{type(value).__name__} {str(value)[:60]}", expected)])


def _key(name: object, key: str, path: str) -> str:
    if isinstance(name, str):
        return str(name)
    raise DocumentError(path, [Problem(key, f"{name!r}"[:60], "expected a text as key")])
