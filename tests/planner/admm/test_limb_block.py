"""A limb's MIP against enumeration and sampling."""

from __future__ import annotations

import numpy as np
from crux_planner.admm.limb_block import LimbBlock
from crux_planner.admm.limb_paths import LimbPaths
from crux_planner.trajectory.consensus import Eta, Scales
from scenes import scene

LIMB, RHO, SCALES = 0, 10.0, Scales()


def target_of(steps: int, seed: int) -> Eta:
    rng = np.random.default_rng(seed)
    target = Eta.zeros(steps)
    target.fingers[:] = np.array([0.2, 0.36, 0.035]) + rng.normal(scale=0.1, size=target.fingers.shape)
    target.forces[:] = rng.normal(scale=10.0, size=target.forces.shape)
    return target


def test_the_path_is_the_best_of_all() -> None:
    small = scene(20, width_m=0.2, goal_m=0.06)
    windows = small.windows
    rng = np.random.default_rng(1)
    for _ in range(20):
        held = rng.normal(size=(windows.count, len(small.problem.contacts)))
        arcs = rng.normal(size=len(windows.arcs[LIMB]))
        start = small.problem.start_contacts[LIMB]
        costs = []
        for taken in [None, *range(len(arcs))]:
            if taken is not None and windows.arcs[LIMB][taken].start != start:
                continue
            swings = [] if taken is None else [windows.swinging(LIMB, windows.arcs[LIMB][taken])]
            contacts = windows.held(LIMB, swings)
            if contacts[-1] in windows.goals[LIMB]:
                price = 0.0 if taken is None else arcs[taken]
                costs.append(price + sum(held[t, c] for t, c in enumerate(contacts) if c is not None))
        paths = LimbPaths(windows, LIMB)
        best = paths.shortest(held, arcs)
        found = paths.swings(best)
        contacts = windows.held(LIMB, found)
        number = {windows.swinging(LIMB, arc): i for i, arc in enumerate(windows.arcs[LIMB])}
        price = sum(arcs[number[swing]] for swing in found)
        price += sum(held[t, c] for t, c in enumerate(contacts) if c is not None)
        assert price <= min(costs) + 1e-9
        assert abs(price - best.cost) < 1e-9


def test_wrenches_keep_the_surface_and_beat_every_sample() -> None:
    small = scene(20, width_m=0.2, goal_m=0.06)
    target = target_of(20, 2)
    answers, costs = LimbBlock(small.windows, small.equilibrium, LIMB)._wrenches(RHO, target, SCALES)
    equilibrium, problem = small.equilibrium, small.problem
    rng = np.random.default_rng(0)
    for k in (0, 7, 19):
        for c in small.windows.contacts[LIMB]:
            q = answers[k, c]
            load, spine = equilibrium.load[c], equilibrium.spine[c]
            for f in (0, 1):
                assert (equilibrium.directions @ q[:3] <= load[f] * q[3 + f] + spine[f] + 1e-4).all()
            contact = problem.contacts[c]

            def price(w: np.ndarray, contact: object = contact, k: int = k) -> float:
                e, t = contact.axis, contact.tangent  # type: ignore[attr-defined]
                shear = w[0] * t + w[1] * np.array([0, 0, 1.0])
                forces = np.stack([w[3] * e + shear, -w[4] * e + shear])
                goal = target.forces[k, 2 * LIMB : 2 * LIMB + 2]
                near = RHO / 2 * SCALES.force**2 * (((forces - goal) ** 2).sum() - (goal**2).sum())
                turn = RHO / 2 * SCALES.moment**2 * 2 * w[2] ** 2
                twist = (w[2] / problem.patch.k_m) ** 2
                return float(
                    near + turn + problem.weights.wrench * (2 * (w[0] ** 2 + w[1] ** 2 + twist) + w[3] ** 2 + w[4] ** 2)
                )

            assert abs(price(q) - costs[k, c]) < 1e-6
            for _ in range(200):
                other = q + rng.normal(scale=[2.0, 2.0, 0.02, 2.0, 2.0])
                inside = all(
                    (equilibrium.directions @ other[:3] <= load[f] * other[3 + f] + spine[f]).all() for f in (0, 1)
                )
                if inside and (other[3:] >= 1.0).all() and (other[3:] <= equilibrium.max_normal_N).all():
                    assert price(other) >= price(q) - 1e-4
