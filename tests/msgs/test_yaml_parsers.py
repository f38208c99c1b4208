"""Both of PyYAML's parsers, the compiled one and its own, make the same of a text, or refuse it in the same words."""

from pathlib import Path

import pytest
import yaml
from crux_contracts import yaml_document
from crux_contracts.yaml_document import DocumentError, Node, parse_mapping

MSGS = Path(__file__).resolve().parents[2] / "msgs"
FILES = sorted((MSGS / "scenarios").glob("*.yaml")) + sorted((MSGS / "robots").glob("*/robot.yaml"))
ODD = [
    "a: 1\nb: [1, {c: '2', d: \"x\"}, ~]\n'e': |\n  text\n  more\nf: >-\n  folded\n  text\n",
    "a: !!int '1'\n",
    "a: &b 1\nc: *b\n",
    "a: 1\na: 2\n",
    "a: [1, 2\nb: 3\n",
    "a: 'open\n",
    "a:\t1\nb: 2\t\n",
    "a: 1\n---\nb: 2\n",
    "\ta: 1\n",
    "a: \x07\n",
    "? [a]\n: b\n",
    "a: \u2018b\u2019\nc: \u00e9: d\n",
]


def _read(text: str) -> Node | str:
    yaml_document._document.cache_clear()
    try:
        return parse_mapping(text.encode(), "file")
    except DocumentError as error:
        return str(error)


@pytest.mark.parametrize("text", [*(file.read_text(encoding="utf-8") for file in FILES), *ODD])
def test_the_compiled_parser_makes_the_same_of_a_text(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = _read(text)
    monkeypatch.setattr(yaml_document, "_COMPILED", None)
    assert compiled == _read(text)


def test_texts_are_read_by_the_compiled_parser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(yaml, "SafeLoader")
    assert isinstance(_read("a: 1\n"), Node)
