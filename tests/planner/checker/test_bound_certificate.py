"""Certificates of bounds of J: what is written is verified from the file alone, what shows less is refused."""

from __future__ import annotations

import copy
import itertools
import json
import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.cost_weights import CLIMB
from crux_contracts.plan_file import read_plan
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.checker.certificate import CertificateError, digest, read, vector, verify
from crux_planner.checker.cheapest_way import CheapestWay, Program, least_knots
from crux_planner.checker.cost import cost
from crux_planner.checker.grips import offers
from crux_planner.checker.knot_cost import GripCosts, KnotCosts
from crux_planner.checker.limit_surface import cone_excess
from crux_planner.checker.no_way import AIR, Node, NotShownError, NoWay
from crux_planner.checker.outer import FOLLOW
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.plan_arrays import read_plan as arrays_of
from crux_planner.checker.report import Findings
from crux_planner.pipeline.bound_certificate import certify_bound
from crux_tools.cli import main
from crux_tools.paths import SCENARIOS
from walls import hold, one_move, scenario, two_rows

ROBOT = load_robot("scaler")
ONE_STEP = SCENARIOS / "climb-one-step.yaml"
SHORT = 9  # steps of the certificate that is damaged here: no plan is that short, bounds do not ask


@lru_cache
def certified() -> dict[str, Any]:
    return certify_bound(load_scenario(ONE_STEP), ROBOT, SHORT, np.inf)


def refused(document: dict[str, Any], match: str) -> None:
    with pytest.raises(CertificateError, match=match):
        verify({**document, "sha256": digest(document)})


def test_a_bound_is_written_with_a_plan_and_is_below_its_cost(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, proof = tmp_path / "plan.mcap", tmp_path / "proof.json"
    assert main(["plan", str(ONE_STEP), "-o", str(plan), "--certificate", str(proof), "--json"]) == 0
    out, said = capsys.readouterr()
    result, document = json.loads(out), read(proof)
    which = f"no plan of {result['steps']} steps that crux check accepts costs less than {document['bound']:.4f}"
    assert which in said
    assert result["certified_bound"] == document["bound"] > 0.7 * result["cost"]
    assert proof.stat().st_size < 100_000
    assert main(["check", str(proof), "--scenario", str(ONE_STEP)]) == 0
    assert which in capsys.readouterr().out

    arrays, read_wall = arrays_of(read_plan(plan), Findings()), load_scenario(ONE_STEP)
    assert arrays is not None
    counted = cost(arrays, read_wall)
    assert document["bound"] < counted <= result["cost"]
    assert f"this one costs {counted:.4f}" in said
    assert main(["check", str(plan), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cost"] == pytest.approx(counted, rel=1e-12)
    assert counted == pytest.approx(result["cost"], rel=1e-3)  # the NLP adds a little for how spines share loads
    every_knot_of_the_plan_costs_what_is_shown(document, arrays)


def every_knot_of_the_plan_costs_what_is_shown(document: dict[str, Any], plan: PlanArrays) -> None:
    """The bound adds up knots: what is shown of each is less than what the plan has there."""
    way = CheapestWay(load_scenario(ONE_STEP), ROBOT, document["steps"])
    for entry in document["multipliers"]:
        for each in entry["of"]:
            way.show(entry["knot"], vector(each))
    names, weights, goal = [each.name for each in way.search.offers], CLIMB, way.scenario.goal.body
    for k in range(way.steps):
        stance = plan.stance[k]
        grips = [(plan.cuboids.names[h], "xy"[f // 2]) for h, f in zip(plan.hold[k], plan.finger1_face[k], strict=True)]
        node = [names.index(grip) if on else AIR for grip, on in zip(grips, stance, strict=True)]
        own = ((plan.body_position[k] - goal.position_m) ** 2).sum() + (plan.body_rpy[k] ** 2).sum()
        own += weights.wrench * (plan.finger_force[k] ** 2).sum()
        own += weights.wrench * (plan.finger_moment[k] ** 2).sum() / plan.patch_k_m**2
        (at,) = np.flatnonzero((way.knots.sets == node).all(axis=1))
        assert 0.5 * own < way.value[k, at] < own
        place, away = plan.body_position[k], plan.body_position[k] - goal.position_m
        box, yaw = way.window(k)
        assert (box[0] <= place).all()
        assert (place <= box[1]).all()
        assert yaw[0] <= plan.body_rpy[k, 2] <= yaw[1]
        assert way.knots.least(np.zeros(6), np.array([place, place]))[at] == pytest.approx((away**2).sum(), abs=1e-9)
        earned = weights.lift * plan.gripper_position[k, ~stance, 2] + weights.opening * plan.separation[k, ~stance]
        assert way.value[k, at] - way.stages()[k, at] >= earned.sum()


def test_a_wall_elsewhere_costs_the_same() -> None:
    """Multipliers about the origin that are the same about the robot: signs of all moments, and where the mass is."""
    walls, shift, random = [one_move(), one_move()], np.array([0.7, -0.4, 0.0]), np.random.default_rng(3)
    for part in walls[1]["holds"]:
        part["position_m"] = (np.array(part["position_m"]) + shift[:2]).tolist()
    for end in ("start", "goal"):
        body = walls[1][end]["body"]
        body["position_m"] = (np.array(body["position_m"]) + shift).tolist()
    here, there = (KnotCosts(NoWay(scenario(wall), ROBOT), ROBOT) for wall in walls)
    assert (here.sets == there.sets).all()
    for _ in range(3):
        force, moment = random.normal(size=(2, 3)) * [[4e-3], [1e-3]]
        moved = np.concatenate([force - np.cross(moment, shift), moment])
        assert np.allclose(here.least(np.concatenate([force, moment])), there.least(moved), atol=1e-9)


def test_swings_last_as_long_as_the_way_takes() -> None:
    found, dt_s = offers(scenario(two_rows(0.5)), ROBOT), 0.5
    least, speed = least_knots(found, ROBOT, dt_s), ROBOT.grasp.approach_speed_m_s
    for (i, one), (j, other) in itertools.product(enumerate(found), repeat=2):
        way = np.linalg.norm(one.corners_w_m.mean(axis=0) - other.corners_w_m.mean(axis=0))
        assert least[i, j] <= max(np.ceil(way / (speed * dt_s)), 2, np.ceil(np.pi / 2 / (0.25 * dt_s)))
        assert least[i, j] >= max((way - 0.03) / (speed * dt_s) - 0.1, 2)


def test_what_shows_less_than_the_claim_is_refused() -> None:
    """As a whole, a bound 1 % higher; multipliers that are others; a wall that asks for less."""
    document = certified()
    assert "no plan of 9 steps that crux check accepts costs less than" in verify(json.loads(json.dumps(document)))[1]
    refused({**document, "bound": 1.01 * document["bound"]}, "does not show its claim: .* costs less than")
    for every in (True, False):  # or only those of single knots
        other = copy.deepcopy(document)
        for entry in other["multipliers"]:
            if every or entry["knot"] is not None:
                entry["of"] = (-0.5 * np.array(entry["of"])).tolist()
        refused(other, "does not show its claim: .* costs less than")
    other["multipliers"] = [{"knot": None, "of": [[1e300, 0, 0, 0, 0, 0], [0, -1e200, 1e5, 0, 1e300, 0]]}]
    refused(other, "does not show its claim: .* costs less than")
    easier = document["scenario_yaml"].replace("friction: 2.2", "friction: 4")
    refused({**document, "scenario_yaml": easier}, "does not show its claim: .* costs less than")


def test_what_is_no_bound_is_refused() -> None:
    document = certified()
    refused({**document, "robot_sha256": "0" * 64}, "another scaler")
    for wrong in ("9", 9.0, True, None):
        refused({**document, "steps": wrong}, "steps and bound are numbers")
    refused({**document, "bound": float("inf")}, "steps and bound are numbers")
    refused({**document, "steps": 15}, "the scenario has 14")
    refused({**document, "multipliers": [{"knot": 9, "of": []}]}, "expected one before the last")
    refused({**document, "multipliers": [{"knot": None, "of": [[1.0, 2.0]]}]}, "six numbers")
    refused({**document, "multipliers": [{"knot": None, "of": ["x"]}]}, "six numbers")
    for wrong in ("x", None, True, 10**400, math.nan):
        refused({**document, "multipliers": [{"knot": None, "of": [[wrong] + [0] * 5]}]}, "expected a finite number")


def test_walks_and_walls_with_too_many_grips_have_none() -> None:
    with pytest.raises(NotShownError, match="no certificates are known"):
        certify_bound(load_scenario(SCENARIOS / "walk-flat.yaml"), ROBOT, 10, np.inf)
    wall = two_rows(all_limbs=False)
    wall["holds"] += [hold(f"more-{x}-{y}", 0.29 + 0.15 * x, -0.36 + 0.18 * y) for x in (1, 2) for y in range(5)]
    with pytest.raises(NotShownError, match="36 grips"):
        certify_bound(scenario(wall), ROBOT, 40, np.inf)


def test_no_wrench_within_the_limit_surface_costs_less_than_a_grips_least() -> None:
    wall = two_rows()
    for part in wall["holds"]:
        part["size_m"] = [0.06, 0.2, 0.06]
    wall["holds"][0].update(friction={"+x": 0.5, "-x": 1.5, "+y": 1.0, "-y": 0.0, "top": 1}, spines={"-x": False})
    read_wall, random, weight, above = scenario(wall), np.random.default_rng(4), 1e-4, 0.1
    found, k_m = offers(read_wall, ROBOT)[:3], read_wall.contact.patch_k_m
    grips, tight = GripCosts(found, above, k_m, 60.0, weight), np.inf
    for _ in range(40):
        multipliers, slope = random.normal(size=6) * np.repeat([4e-3, 1e-3], 3), random.normal(size=3) * 0.01
        least = grips.least(multipliers, slope)
        for offer, shown in zip(found, least, strict=True):
            normal = random.uniform(0.0, 60.0, (4000, 2)) * random.integers(0, 2, (4000, 2))
            load = random.normal(size=(4000, 3)) * random.uniform(0.0, 40.0, (4000, 1))
            over = [
                cone_excess(
                    load[:, :2], load[:, 2] * k_m, normal[:, f], friction=offer.friction[f], patch_k_m=k_m,
                    spine_shear_N=np.full(4000, offer.spines[f, 0]), spine_twist_Nm=offer.spines[f, 2] * k_m,
                ) for f in (0, 1)
            ]  # fmt: skip
            own = np.max(over, axis=0) <= 0.0
            normal, load = normal[own], load[own]
            place = random.dirichlet(np.full(4, 0.1), len(load)) @ offer.corners_w_m
            force = (normal[:, :1] - normal[:, 1:]) * offer.axis + 2 * load[:, :1] * offer.tangent
            force[:, 2] += 2 * load[:, 1]
            moment = np.cross(place, force) + 2 * load[:, 2:] * k_m * offer.axis
            costs = weight * (2 * (load**2).sum(axis=1) + (normal**2).sum(axis=1))
            costs -= np.column_stack([force, moment]) @ multipliers
            costs += FOLLOW * (place @ slope + above * slope[2])
            assert shown <= costs.min()
            tight = min(tight, float(costs.min() - shown))
    assert tight < 3e-3


def test_the_program_finds_the_cheapest_of_all_ways() -> None:
    """Against every way written out: two limbs that move among three grips, two that stay."""
    random = np.random.default_rng(1)
    for steps in (6, 7):
        sets = np.array([(a, b, 3, 4) for a in (AIR, 0, 1, 2) for b in (AIR, 0, 1, 2) if a != b or a == AIR])
        air, change = random.integers(2, 4, (5, 5)), 0.3
        stages = random.uniform(-0.2, 1.0, (steps, len(sets)))
        start: Node = (0, 1, 3, 4)
        goals: set[Node] = {(1, 2, 3, 4), (2, 0, 3, 4)}
        program = Program(sets, start, goals, np.arange(5), air, change)
        place = {tuple(map(int, each)): i for i, each in enumerate(sets)}
        ways = [way for way in itertools.product(_lines(0, steps, air), _lines(1, steps, air)) if _fits(way, place)]
        ends = {goal[:2] for goal in goals}
        least, through = np.inf, np.full(stages.shape, np.inf)
        for one, two in ways:
            if (one[-1], two[-1]) not in ends:
                continue
            at = [place[a, b, 3, 4] for a, b in zip(one[:-1], two[:-1], strict=True)]
            total = stages[np.arange(steps), at].sum() + change * (_changes(one) + _changes(two))
            least, seen = min(least, total), (np.arange(steps), at)
            through[seen] = np.minimum(through[seen], total)
        assert program.forward(stages) == pytest.approx(least)
        assert np.array_equal(np.isfinite(program.through(stages)), np.isfinite(through))
        assert np.allclose(program.through(stages), through)


def _lines(first: int, steps: int, air: Any) -> list[tuple[int, ...]]:
    """What one limb may do at knots 0 to `steps`: grips and AIR."""
    lines = []
    for rest in itertools.product((AIR, 0, 1, 2), repeat=steps):
        line = (first, *rest)
        runs = [(key, len(list(group))) for key, group in itertools.groupby(line)]
        swings = zip(runs, runs[1:], runs[2:], strict=False)
        whole = all(AIR in (a[0], b[0]) for a, b in itertools.pairwise(runs)) and line[-1] != AIR
        if whole and all(b[1] >= air[a[0], c[0]] for a, b, c in swings if b[0] == AIR):
            lines.append(line)
    return lines


def _fits(way: tuple[tuple[int, ...], tuple[int, ...]], place: dict[tuple[int, ...], int]) -> bool:
    return all((a, b, 3, 4) in place for a, b in zip(way[0][:-1], way[1][:-1], strict=True))


def _changes(line: tuple[int, ...]) -> int:
    return sum((a == AIR) != (b == AIR) for a, b in itertools.pairwise(line))
