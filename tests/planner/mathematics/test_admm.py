"""Equations (15) to (19b): the loops with quadratic blocks that have closed forms, and the real blocks' objectives."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import pytest
from crux_planner.admm.admm import ContactPlan, Settings, multi_block, two_block
from crux_planner.admm.methods import SCALES, WALK_SCALES, _even
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.physics.cost import plan_cost
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Residuals
from crux_planner.trajectory.knot_qp import KnotSolution, solve_knots
from scenes import Scene, scene

STEPS, RHO, Q_1, Q_2 = 2, 3.0, 2.0, 5.0
V = {"position": 3.0, "orientation": 3.0, "rate": 0.1, "force": 0.007, "moment": 0.5}


def drawn(seed: int) -> Eta:
    random, zero = np.random.default_rng(seed), Eta.zeros(STEPS)
    return Eta(*(random.normal(size=getattr(zero, f.name).shape) for f in fields(zero)))


def flat(eta: Eta) -> np.ndarray:
    """All its numbers."""
    return np.concatenate([getattr(eta, f.name).ravel() for f in fields(eta)])


A, B = drawn(1), drawn(2)


def l_1(eta: np.ndarray) -> float:
    return float(Q_1 / 2 * ((eta - flat(A)) ** 2).sum())


def l_2(delta: np.ndarray) -> float:
    return float(Q_2 / 2 * ((delta - flat(B)) ** 2).sum())


def lagrangian(eta: np.ndarray, delta: np.ndarray, epsilon: np.ndarray) -> float:
    """(16) with A_1 eta + A_2 delta - b_0 = eta - delta."""
    return l_1(eta) + l_2(delta) + float(RHO / 2 * (((eta - delta + epsilon) ** 2).sum() - (epsilon**2).sum()))


@dataclass
class Knots:
    """What a contact block decides, here nothing."""

    cost: float = 0.0
    order: list[str] = field(default_factory=list)

    def with_body(self, _body: np.ndarray) -> Knots:
        return self


@dataclass
class Blocks:
    """L_1 and L_2 as the loops' blocks; what the loops asked for and got, one call after another."""

    etas: list[np.ndarray] = field(default_factory=list)
    deltas: list[np.ndarray] = field(default_factory=list)
    asked: list[np.ndarray] = field(default_factory=list)

    def minimise(self, rho: float, target: Eta | None, _deadline: float = 0.0) -> ContactPlan[Any]:
        eta = A if target is None else (A.times(Q_1) + target.times(rho)).times(1 / (Q_1 + rho))
        if target is not None:
            self.asked.append(flat(target))
        self.etas.append(flat(eta))
        return ContactPlan(eta, Knots())

    def project(self, target: Eta, rho: float) -> Eta:
        delta = (B.times(Q_2) + target.times(rho)).times(1 / (Q_2 + rho))
        self.asked.append(flat(target))
        self.deltas.append(flat(delta))
        return delta

    def in_turn(self, copy: Eta, _away: np.ndarray, _before: np.ndarray) -> Eta:
        return copy


def ran(iterations: int) -> Blocks:
    blocks = Blocks()
    two_block(blocks, blocks, Settings(deadline=clock.now() + 60, to_the_end=True), RHO, iterations)
    assert len(blocks.etas) == len(blocks.deltas) == iterations
    return blocks


def duals(blocks: Blocks) -> list[np.ndarray]:
    """epsilon by (17), after every iteration."""
    found = [np.zeros_like(blocks.etas[0])]
    for eta, delta in zip(blocks.etas, blocks.deltas, strict=True):
        found.append(found[-1] + eta - delta)
    return found


def test_equation_15_the_loop_ends_at_the_constrained_minimum() -> None:
    blocks = ran(60)
    least = (Q_1 * flat(A) + Q_2 * flat(B)) / (Q_1 + Q_2)
    np.testing.assert_allclose(blocks.etas[-1], least, atol=1e-6)
    np.testing.assert_allclose(blocks.deltas[-1], least, atol=1e-6)


def test_equation_16_every_step_minimises_the_augmented_lagrangian() -> None:
    blocks, random = ran(8), np.random.default_rng(3)
    epsilons = duals(blocks)
    for i in range(1, 8):
        eta, delta, before, epsilon = blocks.etas[i], blocks.deltas[i], blocks.deltas[i - 1], epsilons[i]
        for size in (1e-3, 0.1):
            off = size * random.normal(size=eta.shape)
            assert lagrangian(eta + off, before, epsilon) > lagrangian(eta, before, epsilon)
            assert lagrangian(eta - off, before, epsilon) > lagrangian(eta, before, epsilon)
            assert lagrangian(eta, delta + off, epsilon) > lagrangian(eta, delta, epsilon)
            assert lagrangian(eta, delta - off, epsilon) > lagrangian(eta, delta, epsilon)


def test_equation_17_the_dual_adds_up_the_residuals() -> None:
    """Seen in what blocks are asked for: the motion eta + epsilon, the contacts delta - epsilon."""
    blocks = ran(8)
    epsilons = duals(blocks)
    for i in range(8):
        np.testing.assert_allclose(blocks.asked[2 * i], blocks.etas[i] + epsilons[i], atol=1e-12)
        if i < 7:
            np.testing.assert_allclose(blocks.asked[2 * i + 1], blocks.deltas[i] - epsilons[i + 1], atol=1e-12)


def test_equation_18_the_copy_is_the_mean_with_the_duals() -> None:
    blocks, first = Blocks(), drawn(4)
    multi_block(blocks, blocks, first, Settings(deadline=clock.now() + 60, to_the_end=True), RHO, 6)  # type: ignore[arg-type]
    copy, of_limbs, of_motion = blocks.deltas[0], np.zeros_like(flat(A)), np.zeros_like(flat(A))
    body = flat(replace(Eta.zeros(STEPS), body=np.ones((STEPS + 1, 12)))) > 0
    for i in range(6):
        np.testing.assert_allclose(blocks.asked[1 + 2 * i], copy - of_limbs, atol=1e-12)
        np.testing.assert_allclose(blocks.asked[2 + 2 * i], copy - of_motion, atol=1e-12)
        delta = blocks.deltas[i + 1]
        eta = np.where(body, delta, blocks.etas[i])  # the body is in the motion's block alone
        copy = (eta + of_limbs + delta + of_motion) / 2
        of_limbs, of_motion = of_limbs + eta - copy, of_motion + delta - copy


def test_equation_18_forces_weigh_as_they_do_in_the_cost() -> None:
    scales = _even(SCALES, RHO, 1e-4, 0.01)
    assert scales.force == pytest.approx(np.sqrt(2 * 1e-4 / RHO))
    assert scales.moment == pytest.approx(scales.force / 0.01)


@pytest.fixture(scope="module")
def small() -> Scene:
    return scene(10, goal_m=0.03)


def weighted(difference: Eta) -> float:
    """|eta|_V^2 by the page's weights."""
    parts = (
        (V["position"], difference.body[:, :3]),
        (V["orientation"], difference.body[:, 3:6]),
        (V["rate"], difference.body[:, 6:]),
        (V["position"], difference.fingers),
        (V["orientation"], difference.yaws),
        (V["force"], difference.forces),
        (V["moment"], difference.moments),
    )
    return float(sum(weight**2 * (values**2).sum() for weight, values in parts))


def test_equation_19a_contacts_minimise_the_cost_and_the_distance_to_the_copy(small: Scene) -> None:
    """P2a with its binaries fixed is convex: from its answer towards others that are feasible, its sum only grows."""
    problem, schedule, random = small.problem, small.windows.schedule([]), np.random.default_rng(5)
    balance = StaticBalance(problem, problem.friction_share)
    path = np.linspace(problem.start.position_m, problem.goal.body.position_m, problem.steps + 1)
    rho = 10.0

    def eta_of(found: KnotSolution) -> Eta:
        return Eta.of_contacts(problem, schedule, found.body, found.wrenches)

    def solved(target: Eta | None) -> KnotSolution:
        found = solve_knots(problem, balance, schedule, rho if target else 0.0, target, SCALES, path, False)
        assert found is not None
        return found

    alone = solved(None)
    noises = [random.normal(size=(problem.steps, 8, 3)) for _ in range(3)]
    targets = [replace(eta_of(alone), forces=eta_of(alone).forces + 15 * noise) for noise in noises]
    aside = np.array([0.01, -0.02, 0.0, *[0.0] * 3, 0.05, *[0.0] * 5])
    targets.append(replace(targets[0], body=targets[0].body + aside))
    answers = [solved(target) for target in targets]

    def objective(body: np.ndarray, wrenches: list[dict[int, np.ndarray]], target: Eta) -> float:
        eta = Eta.of_contacts(problem, schedule, body, wrenches)
        return plan_cost(problem, schedule, body, wrenches) + rho / 2 * weighted(eta - target)

    for answer, target in zip(answers, targets, strict=True):
        best = objective(answer.body, answer.wrenches, target)
        for other in (alone, *answers):
            if other is answer:
                continue
            for share in (0.02, 0.3):
                body = (1 - share) * answer.body + share * other.body
                pairs = zip(answer.wrenches, other.wrenches, strict=True)
                mixed = [{limb: (1 - share) * q[limb] + share * p[limb] for limb in q} for q, p in pairs]
                assert objective(body, mixed, target) > best


def test_equation_19b_the_motions_objective_is_the_weighted_distance(
    small: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, costs, rho = small.problem, [], 10.0
    body = np.tile([*problem.start.position_m, *[0.0] * 9], (11, 1))
    target = Eta.of_contacts(problem, small.windows.schedule([]), body, [{} for _ in range(10)])
    target.forces[:] = np.random.default_rng(3).normal(scale=4.0, size=target.forces.shape)
    block = MotionBlock(problem, scales=SCALES)
    solve = block._nlp.solve

    def kept(*args: Any, **how: Any) -> Any:
        costs.append(solve(*args, **how))
        return costs[-1]

    monkeypatch.setattr(block._nlp, "solve", kept)
    delta = block.project(target, rho)
    assert costs[-1].cost == pytest.approx(rho / 2 * weighted(delta - target), rel=1e-9)
    assert Residuals.of(delta - target).force_N > 0.5


def test_equation_19a_weights_and_thresholds_of_the_page() -> None:
    assert {name: getattr(SCALES, name) for name in V} == V
    walking = [getattr(WALK_SCALES, name) for name in ("position", "orientation", "rate", "force")]
    assert walking == [1.0, 1.0, 0.1, 0.01]
    off = Eta.zeros(STEPS)
    off.fingers[0, 0, 0], off.forces[0, 0, 0] = 0.03, 0.5
    assert Residuals.of(off).converged
    off.forces[0, 0, 0] = 0.501
    assert not Residuals.of(off).converged
