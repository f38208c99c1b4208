"""The contact MILP against enumeration, and its cost against the definition of the proximal term."""

from __future__ import annotations

import itertools

import numpy as np
from crux_planner.admm.contact_block import ClimbContacts
from crux_planner.admm.hull import SHARES, SQUARED, HullMilp, WindowCost
from crux_planner.admm.window_cost import window_cost
from crux_planner.model.schedule import Swinging
from crux_planner.physics.cost import schedule_cost
from crux_planner.trajectory.consensus import Eta, Scales
from scenes import Scene, scene, square
from scipy.linalg import block_diag
from scipy.optimize import linprog


def linear_cost(small: Scene, seed: int) -> WindowCost:
    """Random costs of holding contacts and of swings, nothing else."""
    windows, rng = small.windows, np.random.default_rng(seed)
    many = len(small.problem.contacts)
    return WindowCost(
        square=np.zeros((windows.count, SQUARED)),
        body_linear=np.zeros((windows.count, 3)),
        body_square=np.zeros((windows.count, 3)),
        linear=np.zeros((windows.count, 4, many, SHARES)),
        held=rng.uniform(-1, 1, (windows.count, 4, many)),
        arcs=[rng.uniform(-1, 1, len(arcs)) for arcs in windows.arcs],
    )


def can_stand(small: Scene, airborne: list[Swinging]) -> bool:
    """Whether reach, forces (8a) and free ways hold in every window, by linear programs of their own."""
    windows, reach, problem = small.windows, small.reach, small.problem
    held = [windows.held(limb, airborne) for limb in range(4)]
    for t in range(windows.count):
        low, high = windows.body_range()
        if t == 0:
            low = high = problem.start.position_m
        if t == windows.count - 1:
            slack = problem.goal.position_slack_m
            low, high = problem.goal.body.position_m - slack, problem.goal.body.position_m + slack
        support: list[int] = []
        for limb in range(4):
            c = held[limb][t]
            first, end = windows.span(t)
            flying = [s for s in airborne if s.limb == limb and s.first < end and s.end > first]
            ends = [c] if c is not None else [flying[0].start, flying[0].goal]
            low = np.maximum(low, reach.low[limb, ends].min(axis=0))
            high = np.minimum(high, reach.high[limb, ends].max(axis=0))
            if c is not None:
                support.append(c)
                continue
            standing = [other for other in (h[t] for h in held) if other is not None]
            if not all(small.swings.free([(flying[0].start, flying[0].goal)], (other,)) for other in standing):
                return False
        if not support or (low > high + 1e-9).any() or not carried(small, support):
            return False
    return True


def carried(small: Scene, support: list[int]) -> bool:
    """Whether grips on the contacts can hold the weight, wherever its moments would turn the robot."""
    limits = [small.equilibrium.limit_rows(c) for c in support]
    forces = np.hstack([np.pad(small.equilibrium.maps[c][:3], ((0, 0), (0, 1))) for c in support])
    rows, right = block_diag(*[rows for rows, _ in limits]), np.concatenate([most for _, most in limits])
    bounds = [(None, None)] * 4 + [(0.0, None)]
    found = linprog(np.zeros(5 * len(support)), rows, right, forces, -small.problem.weight_N, bounds * len(support))
    return bool(found.success)


def test_the_optimum_is_that_of_enumeration() -> None:
    small = scene(20, width_m=0.2, goal_m=0.06)
    windows = small.windows
    assert max(map(len, windows.contacts)) <= 3  # few enough to enumerate
    milp = HullMilp(windows, small.equilibrium)
    for seed in range(3):
        cost = linear_cost(small, seed)
        options: list[list[tuple[float, list[Swinging]]]] = []
        for limb in range(4):
            swings = [(0.0, list[Swinging]())]
            swings += [
                (cost.arcs[limb][i], [windows.swinging(limb, arc)])
                for i, arc in enumerate(windows.arcs[limb])
                if arc.start == small.problem.start_contacts[limb]
            ]
            options.append([way for way in swings if windows.held(limb, way[1])[-1] in windows.goals[limb]])
        best = np.inf
        for chosen in itertools.product(*options):
            airborne = [swing for _, way in chosen for swing in way]
            total = sum(price for price, _ in chosen)
            for limb in range(4):
                total += sum(cost.held[t, limb, c] for t, c in enumerate(windows.held(limb, airborne)) if c is not None)
            if total < best - 1e-12 and can_stand(small, airborne):
                best = total
        result = milp.solve(cost, gap=1e-7, time_limit_s=20.0)
        assert result.values is not None
        assert abs(result.objective - best) < 1e-5
        assert result.bound <= best + 1e-5


def test_moments_are_not_in_the_block() -> None:
    """Where swings are all that counts, it lets limbs fly together with which the robot would turn over."""
    small = scene(20, width_m=0.2, goal_m=0.06)
    cost = linear_cost(small, 0)
    for arcs in cost.arcs:
        arcs[:] = -10.0
    milp = HullMilp(small.windows, small.equilibrium)
    decision = milp.decision(milp.solve(cost, gap=1e-6, time_limit_s=20.0))
    assert can_stand(small, decision.swings)
    reach, held = small.reach, [small.windows.held(limb, decision.swings) for limb in range(4)]
    fallen = 0
    for t in range(small.windows.count):
        support = {limb: c for limb in range(4) if (c := held[limb][t]) is not None}
        low = np.max([reach.low[limb, c] for limb, c in support.items()], axis=0)
        high = np.min([reach.high[limb, c] for limb, c in support.items()], axis=0)
        fallen += small.equilibrium.position(tuple(support.values()), low, high, (low + high) / 2) is None
    assert fallen


def test_the_proximal_term_of_poses_is_exact() -> None:
    small, rho = scene(40), 10.0
    windows, problem, scales = small.windows, small.problem, Scales()
    rng = np.random.default_rng(5)
    target = Eta.zeros(problem.steps)
    target.fingers[:] = rng.normal(size=target.fingers.shape)
    target.yaws[:] = rng.normal(size=target.yaws.shape)
    cost = window_cost(windows, rho, target, scales)
    values = []
    for limb, number in ((0, 0), (0, 7), (3, 4)):
        arc = windows.arcs[limb][number]
        if arc.start != problem.start_contacts[limb]:
            continue
        airborne = [windows.swinging(limb, arc)]
        schedule = windows.schedule(airborne)
        eta = Eta.of_contacts(problem, schedule, np.zeros((problem.steps + 1, 12)), [{} for _ in range(problem.steps)])
        difference = eta - target
        direct = rho / 2 * ((difference.fingers[:-1] ** 2).sum() + (difference.yaws[:-1] ** 2).sum())
        direct += schedule_cost(schedule, problem)
        summed = cost.arcs[limb][number] + sum(
            cost.held[t, other, c]
            for other in range(4)
            for t, c in enumerate(windows.held(other, airborne))
            if c is not None
        )
        values.append(summed - direct)
    assert len(values) >= 2
    np.testing.assert_allclose(values, values[0], atol=1e-8)
    np.testing.assert_allclose(values[0], 0.0, atol=1e-8)


def test_what_the_mip_minimises_is_the_cost_with_its_constants() -> None:
    """A gap is a share of J and the consensus term, not of what is left of them without constants."""
    small, rho, scales = scene(30), 10.0, Scales(position=3.0, force=0.007)
    block = ClimbContacts(small.windows, scales)
    first = block.minimise(rho, None, small.later)
    target = first.eta + first.eta.times(0.0)
    target.forces[:] += np.random.default_rng(2).normal(scale=4.0, size=target.forces.shape)
    again = block.minimise(rho, target, small.later)
    value = again.knots.cost + rho / 2 * square(again.eta - target, scales)
    cost = window_cost(small.windows, rho, target, scales)
    found = HullMilp(small.windows, small.equilibrium).solve(cost, gap=0.01, time_limit_s=20.0)
    assert 0.6 * value < found.objective <= value
