"""Interpolation between knots against scipy's."""

import numpy as np
import pytest
from crux_contracts.pchip import Pchip
from scipy.interpolate import PchipInterpolator


@pytest.mark.parametrize("count", [2, 3, 9])
@pytest.mark.parametrize("shape", [(), (6,), (4, 3)])
def test_values_and_slopes_are_scipys(count: int, shape: tuple[int, ...]) -> None:
    random = np.random.default_rng(count)
    for round_ in range(20):
        places = np.cumsum(random.uniform(0.01, 2.0, count))
        values = random.normal(size=(count, *shape))
        values[random.uniform(size=values.shape) < 0.3] = float(round_ % 2)  # flat in places
        at = np.append(random.uniform(places[0] - 0.1, places[-1] + 0.1, (5, 4)).ravel(), places).reshape(-1, 1)
        found, expected = Pchip(places, values), PchipInterpolator(places, values)
        np.testing.assert_allclose(found(at), expected(at), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.rate(at), expected.derivative()(at), rtol=1e-9, atol=1e-9)
        assert found(places[1]) == pytest.approx(values[1])


@pytest.mark.parametrize(("places", "value"), [([0.0, 1.0, 1.0], 0.0), ([0.0, np.nan, 2.0], 0.0), ([0, 1, 2], np.inf)])
def test_what_is_no_function_is_refused(places: list[float], value: float) -> None:
    with pytest.raises(ValueError, match="rising places and finite values"):
        Pchip(np.array(places), np.array([0.0, value, 1.0]))
