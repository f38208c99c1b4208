"""casadi's functions run as casadi runs them, and kept on disk: the same numbers, whatever is in the cache."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from crux_planner.model import kept
from crux_planner.solvers import mapped, tape
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


@pytest.mark.parametrize("built", [True, False])
@pytest.mark.parametrize("places", [1, 8, 19])
def test_every_operation_is_as_casadi_has_it(built: bool, places: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert tape.library() is not None
    if not built:
        monkeypatch.setattr(tape, "library", lambda: None)
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    far = ca.sqrt(x[0] ** 2 + 1.5) / ca.fabs(y[1])
    outputs = [
        ca.vertcat(ca.sin(x[0]), ca.cos(x[1]), ca.atan2(y[0], x[2]), -x[1], 1 / y[0], x[2] + x[2], ca.sign(x[0]), y[1]),
        ca.horzcat(x * y[0] - far, x / y[1] + far),
        ca.jacobian(far * ca.sin(x[1]), ca.vertcat(x, y)),
        ca.SX(2, 1),
    ]
    made = Mapped("all", [x, y], outputs)
    found = {int(operation) for operation in made.tape.code[0]}
    assert found >= set(range(len(tape._OPERATIONS))) - {tape._NUMBERS[ca.OP_ASSIGN]}
    random = np.random.default_rng(1)
    at = random.normal(size=(places, 3)), random.normal(size=(places, 2))
    each = [made.function(*(argument[i] for argument in at)) for i in range(places)]
    for k, of_all in enumerate(made(*at)):
        wanted = np.array([np.array(result[k]) for result in each]).reshape(of_all.shape)
        if built:
            np.testing.assert_array_equal(of_all, wanted)
        else:  # whose sines and roots may round otherwise
            np.testing.assert_allclose(of_all, wanted, rtol=1e-14)


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match=r"arguments of shapes \[\(7, 2\)\]: expected 7 rows of \[3\]"):
        make()(AT[:, :2])
    x = ca.SX.sym("x")
    with pytest.raises(ValueError, match=r"erf: operation .* of instruction 1: expected one of tape\.h"):
        Mapped("erf", [x], [ca.erf(x)])


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
