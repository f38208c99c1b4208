"""casadi's functions kept on disk: the same numbers, whatever is in the cache."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from crux_planner.model import kept
from crux_planner.solvers import mapped
from crux_planner.solvers.mapped import Mapped

AT = np.random.default_rng(0).normal(size=(7, 3))


@pytest.fixture(autouse=True)
def _empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def make(power: int = 3) -> Mapped:
    x = ca.SX.sym("x", 3)
    value = ca.sin(x[0] * x[1]) + x[2] ** power
    return Mapped("test", [x], [value, ca.gradient(value, x), ca.hessian(value, x)[0]])


def never() -> Mapped:
    raise AssertionError("made again")


def same(one: Mapped, other: Mapped) -> bool:
    return all((a == b).all() for a, b in zip(one(AT), other(AT), strict=True))


def test_a_function_read_again_gives_the_same_bits() -> None:
    assert same(Mapped.kept("a", make), make())
    assert same(Mapped.kept("a", never), make())


def test_other_given_numbers_are_another_function() -> None:
    Mapped.kept(("power", 3), make)
    assert not same(Mapped.kept(("power", 2), lambda: make(2)), make())


@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_file_written_in_part_is_written_anew(share: float) -> None:
    Mapped.kept("a", make)
    (file,) = (kept.cache_folder() / "functions").iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    assert same(Mapped.kept("a", make), make())
    assert same(Mapped.kept("a", never), make())


def test_functions_of_another_casadi_or_program_are_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    Mapped.kept("a", make)
    monkeypatch.setattr(ca.CasadiMeta, "version", lambda: "0.0")
    with pytest.raises(AssertionError, match="made again"):
        Mapped.kept("a", never)
    monkeypatch.undo()
    monkeypatch.setattr(mapped, "_source", lambda: "another")
    with pytest.raises(AssertionError, match="made again"):
        Mapped.kept("a", never)


def test_only_the_newest_functions_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapped, "_MOST", 3)
    for name in "abcd":
        Mapped.kept(name, make)
    assert len(list((kept.cache_folder() / "functions").iterdir())) == 3
    Mapped.kept("d", never)


def test_a_function_is_made_once_in_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mapped, "_MADE", {})
    monkeypatch.setattr(mapped, "_MOST", 2)
    made = Mapped.once("a", make)
    assert Mapped.once("a", never) is made
    Mapped.once("b", make)
    Mapped.once("a", never)
    Mapped.once("c", make)
    Mapped.once("a", never)
    with pytest.raises(AssertionError, match="made again"):  # asked for longest ago
        Mapped.once("b", never)
