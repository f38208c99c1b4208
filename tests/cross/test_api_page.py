"""The API page names what is public; all of it is typed and explained."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib import import_module
from types import ModuleType

import crux_planner
import pytest
from crux_tools.paths import ROOT

PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
DIRECTIVE = re.compile(r"^\.\. auto\w+:: (\S+)((?:\n   :.*)*)", re.MULTILINE)
HEAVY = ("casadi", "highspy", "piqp", "scipy")
PACKAGES = ("crux_contracts", "crux_msgs", "crux_planner", "crux_tools", "crux_simulation")


def found(path: str) -> object:
    module, _, name = path.rpartition(".")
    try:
        return import_module(path)
    except ImportError:
        return getattr(import_module(module), name)


def entries() -> Iterator[tuple[str, object, list[str]]]:
    """Every name of the page, what it stands for, and which of its members the page shows."""
    for path, options in DIRECTIVE.findall(PAGE):
        thing = found(path)
        given = {key: value.split(", ") for key, value in re.findall(r":([\w-]+): ?(.*)", options)}
        shown = given.get("members", [])
        if shown == [""]:
            home = thing.__name__ if isinstance(thing, ModuleType) else ""
            own = [name for name, each in vars(thing).items() if not home or getattr(each, "__module__", "") == home]
            shown = [name for name in own if not name.startswith("_") and name not in given.get("exclude-members", [])]
        yield path, thing, shown


ENTRIES = list(entries())
SHOWN = [(path, thing) for path, thing, _ in ENTRIES]
SHOWN += [
    (f"{path}.{name}", getattr(thing, name)) for path, thing, names in ENTRIES for name in names if name in dir(thing)
]


def hints(thing: object) -> Iterator[tuple[str, object]]:
    """Names and annotations of what a caller sees of a function, a property or a class."""
    if isinstance(thing, property):
        thing = thing.fget
    if isinstance(thing, type):
        yield from ((name, hint) for name, hint in inspect.get_annotations(thing).items() if not name.startswith("_"))
        if "__init__" not in vars(thing) or is_dataclass(thing):
            return
        thing = thing.__init__  # type: ignore[misc]
    if inspect.isroutine(thing):
        signature = inspect.signature(thing)
        yield from (
            (name, each.annotation) for name, each in signature.parameters.items() if name not in ("self", "cls")
        )
        yield "return", signature.return_annotation


def test_everything_public_of_the_planner_is_on_the_page() -> None:
    named = {path for path, _ in SHOWN}
    assert {f"crux_planner.{name}" for name in crux_planner.__all__} <= named
    assert {*crux_planner.__all__} <= {*dir(crux_planner)}  # which completes names in a notebook


@pytest.mark.parametrize(("path", "thing"), [each for each in SHOWN if not each[0].startswith("crux_tools.")])
def test_its_types_are_given_and_none_is_any(path: str, thing: object) -> None:
    for name, hint in hints(thing):
        assert hint is not inspect.Parameter.empty, f"{path}: {name} has no type"
        assert not re.search(r"\bAny\b", str(hint)), f"{path}: {name}: {hint}"


def explained_fields(thing: type) -> set[str]:
    """Fields that a text of their own follows, as autodoc shows them."""
    (body,) = ast.parse(textwrap.dedent(inspect.getsource(thing))).body
    assert isinstance(body, ast.ClassDef)
    pairs = zip(body.body, body.body[1:], strict=False)
    return {
        field.target.id
        for field, text in pairs
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(text, ast.Expr)
    }


def test_it_is_explained() -> None:
    for path, thing in SHOWN:
        if isinstance(thing, property | type) or inspect.isroutine(thing):
            assert thing.__doc__, path
    assert "arrays" in {name for path, _, names in ENTRIES for name in names if path == "crux_planner.PlanResult"}
    for path in ("crux_planner.PlanResult", "crux_planner.PlanSeries", "crux_planner.checker.CheckReport"):
        thing = found(path)
        assert isinstance(thing, type)
        assert is_dataclass(thing)
        assert {field.name for field in fields(thing)} <= explained_fields(thing), path
        assert re.search(rf"autoclass:: {re.escape(path)}\n   :members:\n", PAGE), path


def test_importing_the_planner_loads_no_optimisation_library() -> None:
    light = ", ".join(sorted({*crux_planner.__all__} - {"Planner"}))  # it compiles a problem, so it needs all of them
    program = f"import sys, crux_planner; from crux_planner import {light}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert not set(HEAVY) & set(done.stdout.split())
    assert "crux_planner.pipeline.entry" in done.stdout.split()


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_say_that_they_are_typed(package: str) -> None:
    path = import_module(package).__file__
    assert path is not None
    assert (ROOT / path).with_name("py.typed").is_file()
