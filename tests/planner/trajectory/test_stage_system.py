"""The compiled Newton system of a chain of knots against one dense system of all of them."""

import numpy as np
import pytest
from crux_planner.trajectory.native import StageSystem

STATES, LIMBS, COLUMN, ACTING = 12, 4, 8, 5


def drawn(knots: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """What the system is of, and slopes and defects; Hessians are symmetric, and bend either way."""
    random = np.random.default_rng(knots)
    states = random.normal(size=(knots + 1, STATES, STATES)) + 5.0 * np.eye(STATES)
    columns = random.normal(size=(knots, LIMBS, COLUMN, COLUMN)) + 3.0 * np.eye(COLUMN)
    cross, into = random.normal(size=(2, knots, LIMBS, STATES, COLUMN)) * (np.arange(COLUMN) < ACTING)
    system = [states + states.swapaxes(-1, -2), columns + columns.swapaxes(-1, -2), cross]
    system += [random.normal(size=(knots, STATES, STATES)), into]
    shapes = (knots + 1, STATES), (knots, LIMBS, COLUMN), (knots, STATES)
    return system, [random.normal(size=shape) for shape in shapes]


def solved_at_once(system: list[np.ndarray], right: list[np.ndarray]) -> np.ndarray:
    """States, columns and multipliers, one after the other, by one dense matrix."""
    hessian, columns, cross, state_map, into = system
    knots, count = len(state_map), LIMBS * COLUMN
    at_u, at_m = STATES * (knots + 1), STATES * (knots + 1) + knots * count
    matrix = np.zeros((at_m + STATES * knots, at_m + STATES * knots))
    for k in range(knots + 1):
        x = slice(STATES * k, STATES * (k + 1))
        matrix[x, x] = hessian[k]
    for k in range(knots):
        x, after, m = (slice(at + STATES * k, at + STATES * (k + 1)) for at in (0, STATES, at_m))
        for limb in range(LIMBS):
            first = at_u + count * k + COLUMN * limb
            u = slice(first, first + COLUMN)
            matrix[u, u], matrix[x, u], matrix[m, u] = columns[k, limb], cross[k, limb], into[k, limb]
            matrix[u, x], matrix[u, m] = cross[k, limb].T, into[k, limb].T
        matrix[m, x], matrix[m, after] = state_map[k], -np.eye(STATES)
        matrix[x, m], matrix[after, m] = state_map[k].T, -np.eye(STATES)
    free = slice(STATES, None)  # the first state is given
    found = np.zeros(len(matrix))
    found[free] = np.linalg.solve(matrix[free, free], -np.concatenate([each.ravel() for each in right])[free])
    return found


@pytest.mark.parametrize("knots", [1, 2, 5])
def test_steps_solve_the_whole_system(knots: int) -> None:
    system, right = drawn(knots)
    found = StageSystem(*system).solve(*right)
    together = np.concatenate([each.ravel() for each in found])
    assert together == pytest.approx(solved_at_once(system, right), rel=1e-7, abs=1e-7)


def test_a_column_without_curvature_is_no_system() -> None:
    system, _ = drawn(2)
    system[1][1, 2, :, 7] = system[1][1, 2, 7] = 0.0
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        StageSystem(*system)
