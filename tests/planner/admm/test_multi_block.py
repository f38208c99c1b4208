"""The loops on blocks that are made up: agreement, turns, turns that are given up, and blocks that part."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from crux_planner.admm.admm import ContactPlan, Decided, Settings, multi_block, two_block
from crux_planner.admm.turns import in_turn
from crux_planner.model.arrays import Array
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Scales

EDGES, WINDOWS = np.array([0, 2, 4, 6, 8]), 4
SCALES = Scales(force=0.0)  # what the motion has limbs bear does not decide who goes first


@dataclass(frozen=True)
class Knots:
    """Who is away, and nothing else."""

    away: Array
    cost: float = 0.0

    @property
    def order(self) -> list[str]:
        return ["LF"]

    def with_body(self, body: Array) -> Knots:
        assert body.shape == (9, 12)
        return self


class Limbs:
    """Two limbs swing for one window, in window 1 unless the copy wishes otherwise; forces are the copy's."""

    def minimise(self, rho: float, target: Eta) -> ContactPlan[Knots]:
        assert rho >= 10.0
        away = np.zeros((WINDOWS, 4))
        for limb in (0, 1):
            wish = target.away[1 : WINDOWS - 1, limb]
            away[1 + int(np.argmax(wish)), limb] = 1.0
        forces = target.forces.copy()
        for t, limb in np.argwhere(away > 0.5):
            forces[EDGES[t] : EDGES[t + 1], 2 * limb : 2 * limb + 2] = 0.0
        return ContactPlan(replace(target, forces=forces, away=away), Knots(away))

    def in_turn(self, copy: Eta, away: Array, before: Array) -> Eta:
        return in_turn(copy, away, before, EDGES, 0, SCALES)

    def disputed(self, apart: Eta) -> Array:
        return np.asarray(np.abs(apart.forces).max(axis=(1, 2))[EDGES[:-1], None] > 0.5, dtype=float)


class Motion:
    """Lets every force be, but where a limb has to bear 10 N."""

    def __init__(self, bearing: tuple[int, int] | None = None) -> None:
        self._bearing = bearing

    def project(self, target: Eta, rho: float) -> Eta:
        assert rho >= 10.0
        delta = Eta(target.body, target.fingers, target.yaws, target.forces.copy(), target.moments)
        if self._bearing is not None:
            t, limb = self._bearing
            delta.forces[EDGES[t] : EDGES[t + 1], 2 * limb] = 10.0
        return delta


def run(motion: Motion) -> tuple[Decided[Knots], list[str]]:
    lines: list[str] = []
    first = replace(Eta.zeros(8), away=np.zeros((WINDOWS, 4)))
    given = Settings(deadline=clock.now() + 60.0, report=lines.append, to_the_end=False)
    return multi_block(Limbs(), motion, first, given, 10.0, 40), lines


def test_limbs_that_all_wish_to_go_at_once_wait_for_one_another() -> None:
    limbs = Limbs().minimise(10.0, replace(Eta.zeros(8), away=np.zeros((WINDOWS, 4))))
    assert limbs.knots.away.sum(axis=1).max() == 2.0
    decided, _ = run(Motion((2, 3)))
    assert decided.converged
    assert decided.knots.away.sum(axis=1).max() == 1.0


def test_turns_with_which_forces_come_no_nearer_are_given_up() -> None:
    """The limb that goes first by itself has to bear the robot then: it goes last."""
    free, _ = run(Motion((2, 3)))
    (t,) = np.flatnonzero(free.knots.away[:, 0])
    decided, lines = run(Motion((int(t), 0)))
    assert decided.converged
    assert decided.knots.away[t, 0] == 0.0
    assert decided.knots.away.sum(axis=1).max() == 1.0
    assert any("too slowly" in line for line in lines)


class Concave:
    """Contacts that push by x along x, |x| <= 100 N, and would rather push far: least -4 x^2 and the consensus."""

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> ContactPlan[Knots]:
        assert clock.now() < deadline
        eta = Eta.zeros(8)
        if target is not None:
            eta.forces[0, 0, 0] = np.clip(rho * target.forces[0, 0, 0] / (rho - 8.0), -100.0, 100.0)
        return ContactPlan(eta, Knots(np.zeros((WINDOWS, 4))))


class OneNewton:
    """Motion by a force of 1 N."""

    def project(self, target: Eta, rho: float) -> Eta:
        assert rho >= 10.0
        delta = target.times(0.0)
        delta.forces[0, 0, 0] = 1.0
        return delta


def test_rho_grows_where_blocks_part() -> None:
    """With rho below 16 each iteration takes such blocks further apart, by 8 / (rho - 8)."""
    lines: list[str] = []
    given = Settings(deadline=clock.now() + 60.0, report=lines.append)
    decided = two_block(Concave(), OneNewton(), given, 10.0, 40)
    assert decided.converged
    assert sum("part: rho" in line for line in lines) == 1
