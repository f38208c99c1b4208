"""`crux bench fields`: its fields are what it says, and its verdicts what the planner said."""

from __future__ import annotations

from crux_contracts.scenario import parse_scenario
from crux_simulation.benchmarks.hold_fields import PROVEN, SOLVED, WRONG, field_job, verdict
from crux_simulation.benchmarks.random_fields import HOLDS, SLOPE_DEG, random_field
from crux_tools.report import results


def test_fields_are_drawn_alike_for_the_same_seed_and_lie_in_their_ranges() -> None:
    texts = [random_field(seed) for seed in (1, 2, 3)]
    assert texts[0] == random_field(1)
    assert len(set(texts)) == 3
    for text in texts:
        field = parse_scenario(text)
        assert HOLDS[0] <= len(field.holds) <= HOLDS[1]
        assert SLOPE_DEG[0] <= field.wall.slope_deg <= SLOPE_DEG[1]


def test_no_field_starts_on_faces_that_carry_nothing() -> None:
    """The first of seed 402 that stands otherwise does."""
    field = parse_scenario(random_field(402))
    for grasp in field.start.grasps.values():
        hold = field.holds[field.hold_index(grasp.hold)]
        pair = slice(0, 2) if grasp.faces == "x" else slice(2, 4)
        assert all(mu > 0.0 or spiny for mu, spiny in zip(hold.friction[pair], hold.spines[pair], strict=True))


def test_a_goal_out_of_reach_is_proven_so() -> None:
    row = field_job(401, 20.0).run().row
    assert verdict(row) == PROVEN
    assert "it is 242 mm outside LF's workspace" in row["reason"]


def test_a_climb_that_ends_off_the_goal_makes_a_solved_field_wrong() -> None:
    assert verdict({"verdict": results.CLIMBED}) == verdict({"verdict": results.PLANNED}) == SOLVED
    assert verdict({"verdict": results.FAILED}) == WRONG
    assert field_job(7, 20.0, climbs=True).climbs
