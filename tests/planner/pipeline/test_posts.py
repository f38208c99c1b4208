"""Tall obstacles: the trunk and links keep off them from the search on, not only once a check has refused a plan; and
starts in which links touch.
"""

from __future__ import annotations

import crux_planner
import pytest
from crux_contracts.scenario import ScenarioError
from walls import one_move, two_rows

HEIGHT_M = 0.25  # above any trunk


def with_post(x_m: float, y_m: float) -> dict[str, object]:
    return {**two_rows(), "obstacles": [{"name": "post", "position_m": [x_m, y_m], "size_m": [0.04, 0.04, HEIGHT_M]}]}


def test_the_body_goes_round_a_post_that_its_cheapest_way_touches() -> None:
    said: list[str] = []
    free = crux_planner.plan(two_rows(), "scaler")
    result = crux_planner.plan(with_post(0.36, 0.0), "scaler", log=said.append)
    assert result.check.ok
    assert max(knot.body_position_w_m[0] for knot in free.plan.knots) > 0.25  # there the trunk would be in the post
    assert not [line for line in said if "clearance_body" in line]


@pytest.mark.parametrize(
    ("place_m", "what"), [((0.0, 0.1), "the trunk"), ((0.14, 0.25), "a link of LF")], ids=["trunk", "link"]
)
def test_a_start_inside_a_post_is_told_so(place_m: tuple[float, float], what: str) -> None:
    with pytest.raises(ScenarioError, match=rf"start\.body: .*: {what} would be \d+ mm inside post"):
        crux_planner.plan(with_post(*place_m), "scaler")


@pytest.mark.parametrize(
    ("places_m", "what"),
    [({"RR": (0.0, -0.1)}, " off the trunk"), ({"RF": (0.0, -0.25), "RR": (0.12, -0.25)}, "one of RR")],
    ids=["trunk", "limb"],
)
def test_a_start_in_which_links_touch_is_told_so(places_m: dict[str, tuple[float, float]], what: str) -> None:
    """Within joint limits: no plan of it passes the check."""
    wall = one_move()
    for limb, place_m in places_m.items():
        name = wall["start"]["grasps"][limb]["hold"]
        next(hold for hold in wall["holds"] if hold["name"] == name)["position_m"] = list(place_m)
    with pytest.raises(ScenarioError, match=rf"start\.body: .*: a link of R. would be .*{what}") as told:
        crux_planner.plan(wall, "scaler")
    assert "expected at least 3 mm" in str(told.value)
