"""A lower bound of J of crawls from multipliers on balance (weak duality), the multipliers other ones in every phase of
the gait.

With multipliers p (3 N) on what body and feet must agree on at the knots - the centre of pressure and a_z, see
bound.centre_of_pressure - the body's part of J is at least b(p) = free + p . outputs - p . Q p / 2, and the feet's
falls apart into the knots (bound.loads) and the gait (bound.crawls). The multipliers of a gait may follow its phases:
lambda + delta with a delta for every knot and phase. What the body then does is no more separate, but with a diagonal D
>= Q it is
    b(lambda + delta) >= b(lambda) + delta . y - delta . D delta / 2,   y = outputs - Q lambda,
which is again a sum over the knots. Any lambda and delta give a bound; those of the bundle are good ones.
"""

from __future__ import annotations

import numpy as np

from crux_planner.certificates.bound.centre_of_pressure import MOST_MULTIPLIER, CentreOfPressure
from crux_planner.certificates.bound.crawls import BETWEEN, Crawls
from crux_planner.certificates.bound.loads import least_loads, least_rising
from crux_planner.model.arrays import Array
from crux_planner.model.gait import LEAST_AIR
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.solvers.qp import Qp

_ROUNDS = 20  # of multipliers for crawls with one step a foot
_SHARES = (1.0, 0.4)  # of those multipliers, tried on all crawls
_ENOUGH = 0.01  # below the bound for one step a foot, where all crawls are as good
_EVEN = 0.29  # sigma, about, in a walk
_KEPT = 24  # columns of the bundle
_NEARNESS = 0.5  # weight on how far the next multipliers are from the best ones
_STIFF = (0.08, 0.5, 350.0)  # how far outputs of the loads follow a multiplier, about


def crawl_bound(problem: WalkProblem) -> float:
    """A number that no crawl costs less than, but for its heading; -inf where multipliers fail or no step fits in."""
    if problem.steps <= LEAST_AIR:
        return -np.inf
    pressure = CentreOfPressure(problem)
    if pressure.paid is None:
        return -np.inf
    n = problem.steps
    multipliers = np.zeros(3 * n)
    multipliers[2 * n :] = 2 * pressure.effort * pressure.gamma * _EVEN
    usual, every = EquilibriumDual(pressure, Crawls(problem, None)), EquilibriumDual(pressure, Crawls(problem, BETWEEN))
    bundle = Bundle(pressure, multipliers)
    for _ in range(_ROUNDS):
        bundle.add(*usual.at(bundle.multipliers))
        bundle.propose()
    usual.at(bundle.best)
    every.learn(usual)
    best = -np.inf
    for share in _SHARES:
        if best < bundle.bound - _ENOUGH:
            best = max(best, every.at(multipliers + share * (bundle.best - multipliers))[0])
    return best


class EquilibriumDual:
    """Bounds from multipliers, of some crawls."""

    def __init__(self, pressure: CentreOfPressure, crawls: Crawls) -> None:
        self.pressure, self.crawls = pressure, crawls
        n, stiff = pressure.steps, pressure.yielding
        self._shift = np.zeros((n, len(crawls.on), 3))  # delta, where it was best
        scale = 1.0 / np.sqrt(np.repeat(np.diag(stiff).reshape(3, n).mean(axis=1), n))
        self._over = ((np.abs(stiff) @ scale) / scale).reshape(3, n).T[:, None]  # D: D - Q is diagonally dominant

    def learn(self, other: EquilibriumDual) -> None:
        """Begin with what another one has found for the phases that both know."""
        for feet, phase in other.crawls.phases.items():
            self._shift[:, self.crawls.phases[feet]] = other._shift[:, phase]

    def at(self, multipliers: Array) -> tuple[float, float, Array]:
        """The bound that multipliers (3 N) give, and of the crawl behind it the cost and the outputs (3 N)."""
        pressure, crawls, n = self.pressure, self.crawls, self.pressure.steps
        common = multipliers.reshape(3, n).T[:, None]
        body = (pressure.outputs - pressure.yielding @ multipliers).reshape(3, n).T[:, None]
        best = np.full((n, len(crawls.on)), -np.inf)
        shift, outputs = self._shift, np.zeros((*best.shape, 3))
        for part in (0.0, 1.0):  # of the way to where body and loads would agree
            tried = shift + part * (body - outputs - self._over * shift) / (self._over + _STIFF)
            tried = _within(common + tried) - common
            value, at = least_loads(pressure, common + tried, crawls.low, crawls.high, crawls.on)
            value += self._shifted(tried, body) - pressure.aside((common + tried)[..., :2])
            better = value > best
            best = np.maximum(best, value)
            shift, outputs = np.where(better[..., None], tried, shift), np.where(better[..., None], at, outputs)
        self._shift = shift
        # with feet that are anywhere: without a multiplier of q
        free = np.broadcast_to(common * [-1.0, -1.0, 0.0], (n, 2, 3))
        least = least_rising(pressure, common[..., 2], 0.0, 0.0, np.array([1 / 4, 1 / 3])) + self._shifted(free, body)
        shift = np.concatenate([shift, free], axis=1)
        outputs = np.concatenate([outputs, np.broadcast_to(body, free.shape)], axis=1)
        cost, phases = crawls.cheapest(np.hstack([best, least]))
        chosen = np.arange(n), phases
        agreed = outputs[chosen].T.ravel() + pressure.yielding @ shift[chosen].T.ravel()
        return pressure.least(multipliers) + cost, cost + float(multipliers @ agreed), agreed

    def _shifted(self, shift: Array, body: Array) -> Array:
        """What the body's part gains by shifted multipliers (..., 3), at least."""
        return np.asarray((shift * (body - self._over * shift / 2)).sum(axis=-1))


def _within(multipliers: Array) -> Array:
    """Multipliers (..., 3) of which those of q are as large as they may be at most."""
    size = np.linalg.norm(multipliers[..., :2], axis=-1, keepdims=True)
    share = np.minimum(1.0, MOST_MULTIPLIER / np.maximum(size, 1e-12))
    return np.concatenate([multipliers[..., :2] * share, multipliers[..., 2:]], axis=-1)


class Bundle:
    """Multipliers that rise by a proximal bundle: where the crawls seen so far, mixed, are in balance with the body.

    Crawls are columns of their cost and outputs; what it proposes need not be trusted: every multiplier gives a bound.
    """

    def __init__(self, pressure: CentreOfPressure, multipliers: Array) -> None:
        self.multipliers, self.bound, self.best = multipliers, -np.inf, multipliers
        self._free = pressure.outputs
        self._inverse = np.linalg.inv(pressure.yielding + _NEARNESS * np.eye(len(multipliers)))
        self._costs: list[float] = []
        self._outputs: list[Array] = []

    def add(self, bound: float, cost: float, outputs: Array) -> None:
        """What the multipliers gave."""
        if bound > self.bound:
            self.bound, self.best = bound, self.multipliers
        self._costs.append(cost)
        self._outputs.append(outputs)

    def propose(self) -> None:
        """Set the next multipliers."""
        columns, costs = np.array(self._outputs), np.array(self._costs)
        about = self._free + _NEARNESS * self.best
        weighed = columns @ self._inverse
        m = len(costs)
        hessian, mixed = weighed @ columns.T + 1e-12 * np.eye(m), (np.ones((1, m)), np.ones(1))
        qp = Qp(hessian, costs - weighed @ about, mixed, None, np.zeros(m), np.ones(m))
        share = np.nan_to_num(qp.solve().x)
        self.multipliers = self._inverse @ (about - share @ columns)
        if m > _KEPT:
            kept = {*np.argsort(-share)[: _KEPT - 1].tolist(), m - 1}
            self._costs = [self._costs[i] for i in kept]
            self._outputs = [self._outputs[i] for i in kept]
