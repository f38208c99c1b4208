"""The search on maps of the limbs' reach: what its masks promise, its stances, and the body's path over the knots."""

from __future__ import annotations

import copy
import itertools
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.build import build_problem
from crux_planner.model.schedule import Move, stance_after
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.footing import Footing
from crux_planner.search.map_search import MapSearch
from crux_planner.search.pose_masks import PoseMasks, grid_about, grown
from crux_planner.search.pose_path import Ended, Moments, clear_path, pose_path
from crux_planner.search.schedule import at_knots
from crux_planner.search.stood_on import StoodOn
from crux_planner.swing.swing_cache import SwingCache
from edges import CONVEX_60, edge, over_a_ledge
from scipy.sparse.csgraph import dijkstra
from walls import hold, ladder, scenario, two_rows


@lru_cache
def search() -> MapSearch:
    robot = load_robot("scaler")
    problem = build_problem(scenario(two_rows()), robot)
    grid = grid_about(problem, 0.03, 0.07, 0.1, 0.07)
    masks = PoseMasks(problem, robot, grid, 0.04)
    return MapSearch(masks, Footing(problem, grid), SwingCache(problem))


def test_every_place_that_is_said_to_balance_does() -> None:
    """Three limbs hold, the fourth is somewhere else than they; a level body at heading 0, which the mask is about."""
    wall = two_rows(slope_deg=60.0)
    wall["contact"]["max_normal_N"] = 40
    for part in wall["holds"]:
        part["friction"] = 0.9
    problem = build_problem(scenario(wall), load_robot("scaler"))
    equilibrium, start = StaticEquilibrium(problem, problem.friction_share), problem.start_contacts
    grid = grid_about(problem, 0.04, 0.07, 0.5, 0.0)
    stands = Footing(problem, grid).stands((None, *start[1:]), equilibrium.mean_place(start))
    assert stands is not None
    cells = np.argwhere(stands)
    assert 30 < len(cells) < 0.2 * stands.size
    for cell in cells.tolist():
        place, _ = grid.pose(cell)
        assert equilibrium.position(start[1:], place, place, place, start) is not None


def test_moves_lead_from_the_start_to_the_goal_one_limb_at_a_time() -> None:
    found, problem = search(), search().problem
    way = found.find((), 500, np.inf)
    assert way is not None
    assert len(way) == 4
    stances = [problem.start_contacts, *(after for _, _, after in way)]
    for (before, limb, after), (here, there) in zip(way, itertools.pairwise(stances), strict=True):
        assert (before, after) == (here, there)
        assert [i for i in range(4) if before[i] != after[i]] == [limb]
        assert len({problem.contacts[c].hold for c in after}) == 4
        assert (found.masks.hold(before) & found.masks.hold(after)).any()
    assert all(problem.may_end(limb, problem.contacts[c]) for limb, c in enumerate(stances[-1]))
    other = found.find({way[0]}, 500, np.inf)
    assert other is not None
    assert way[0] not in other


def test_a_goal_at_which_a_limb_reaches_nothing_has_no_way(robot: Robot) -> None:
    wall = two_rows(all_limbs=False)
    wall["holds"] = [part for part in wall["holds"] if part["name"] != "RR-high"]
    wall["goal"]["body"]["position_m"][0] = 0.45
    problem = build_problem(scenario(wall), robot)
    grid = grid_about(problem, 0.03, 0.07, 0.1, 0.0)
    masks = PoseMasks(problem, robot, grid, 0.04)
    found = MapSearch(masks, Footing(problem, grid), SwingCache(problem))
    assert found.find((), 500, np.inf) is None
    assert found.missing_at_goal().startswith("no hold for LF and RF with")


def test_limbs_that_cross_on_all_of_their_holds_at_the_goal_are_named(robot: Robot) -> None:
    """The front limb of a side is to end below the rear one."""
    wall = two_rows(all_limbs=False)
    wall["holds"] += [hold("upper", 0.21, 0.3), hold("lower", 0.09, 0.3)]
    ends = {"LF": "lower", "LR": "upper"}
    wall["goal"]["grasps"] = {limb: {"hold": name, "faces": "x"} for limb, name in ends.items()}
    problem = build_problem(scenario(wall), robot)
    grid = grid_about(problem, 0.03, 0.07, 0.1, 0.0)
    found = MapSearch(PoseMasks(problem, robot, grid, 0.04), Footing(problem, grid), SwingCache(problem))
    assert len(found.goals) == 0
    assert found.missing_at_goal() == "no holds for LF and LR on which these are off each other"


@pytest.mark.parametrize(("height_m", "stands"), [(0.2, True), (0.17, False)])
def test_a_body_at_the_goal_keeps_off_surfaces(robot: Robot, height_m: float, stands: bool) -> None:
    """Over a ledge that is 155 mm high, and in it."""
    wall = over_a_ledge()
    wall["goal"] = copy.deepcopy(wall["start"])
    wall["goal"]["body"]["position_m"][2] = height_m
    problem = build_problem(parse_scenario(wall), robot)
    grid = grid_about(problem, 0.03, 0.07, 0.1, 0.0)
    there = MapSearch(PoseMasks(problem, robot, grid, 0.04), Footing(problem, grid), SwingCache(problem))
    assert (len(there.goals) > 0) == stands
    assert (there.find((), 5, np.inf) is not None) == stands


def test_a_limb_that_is_left_out_is_not_lifted_from_its_stance() -> None:
    found = search()
    way = found.find((), 500, np.inf)
    assert way is not None
    before, limb, _ = way[0]
    other = found.find({(before, limb, None)}, 500, np.inf)
    assert other is not None
    assert (before, limb) not in [step[:2] for step in other]


def test_estimates_have_no_stance_that_the_map_has_no_pose_on() -> None:
    """And where it has some, these are within the bounds; the start is one of them."""
    found = search()
    problem, start = found.problem, found.problem.start_contacts
    bounds = StoodOn(problem, found)
    stance = bounds.of(start)
    assert stance is not None
    place = problem.boxes.directions @ problem.start.position_m
    assert (stance[0] <= place + 1e-9).all()
    assert (place <= stance[1] + 1e-9).all()
    plain, nowhere = ReachableSet(problem), np.zeros(found.masks.grid.shape, dtype=bool)
    for limb, end in itertools.product(range(4), range(len(problem.contacts))):
        after = stance_after(start, (limb,), (end,))
        some = found.poses(after)
        if plain.of(after) is None:
            continue
        tighter = bounds.of(after)
        assert (tighter is None) == (not some.any())
        if tighter is None:
            continue
        for cell in np.argwhere(some).tolist():
            along = problem.boxes.directions @ found.masks.grid.pose(cell)[0]
            inside = np.maximum(plain.of(after)[0], along), np.minimum(plain.of(after)[1], along)  # type: ignore[index]
            assert (tighter[0] <= inside[0] + 1e-9).all()
            assert (inside[1] <= tighter[1] + 1e-9).all()
    empty = SimpleNamespace(masks=found.masks, poses=lambda _stance: nowhere)
    assert plain.of(start) is not None
    assert StoodOn(problem, empty).of(start) is None  # type: ignore[arg-type]
    ends = [tuple(map(int, goal)) for goal in found.goals]
    assert all(bounds.may_end(end) for end in ends)  # type: ignore[arg-type]
    assert not bounds.may_end(start)


def test_the_nearest_clear_pose_is_the_nearest_of_all() -> None:
    masks = search().masks
    problem, grid = masks.problem, masks.grid
    hands = np.array([[*masks.at(c)] for c in problem.start_contacts])
    pose = np.array([*problem.start.position_m, 0.0, 0.0, 0.0])
    pose += [0.013, -0.008, 0.0, 0.01, 0.0, 0.02]
    grippers = [masks.at(c) for c in problem.start_contacts]
    mask = masks.apart(np.logical_and.reduce([masks.held(i, there) for i, there in enumerate(grippers)]), grippers)
    poses = [np.concatenate(grid.pose(cell)) for cell in np.argwhere(mask).tolist()]
    away = [np.hypot(np.linalg.norm(each[:3] - pose[:3]), 0.3 * (each[5] - pose[5])) for each in poses]
    found = masks.clear_near(pose, hands)
    assert found is not None
    least = np.hypot(np.linalg.norm(found[:3] - pose[:3]), 0.3 * (found[5] - pose[5]))
    assert least == pytest.approx(min(away))
    assert masks.clear_near(pose + 5.0, hands) is None


def test_the_path_is_looked_at_halfway_through_swings_too() -> None:
    """Where a limb does not reach its gripper there, the body goes another way, or none."""
    found = search()
    problem, masks = found.problem, found.masks
    way = found.find((), 500, np.inf)
    assert way is not None
    moves = [Move(before, after, (limb,), *[problem.start.position_m] * 2) for before, limb, after in way]
    air = np.array([found.swings.intervals(before[limb], after[limb]) for before, limb, after in way])
    stances = np.full(len(moves) + 1, 3)
    problem = replace(problem, steps=int(stances.sum() + air.sum()))
    schedule = at_knots(problem, found.swings, moves, stances, air)
    moments = Moments.of(schedule)
    flown = [k for k, knot in enumerate(schedule.contacts[:-1]) if None in knot]
    assert [time for time in moments.times if time % 1] == [k + 0.5 for k in flown]
    begun_in_the_air = replace(schedule, contacts=[[None, *knot[1:]] for knot in schedule.contacts])
    assert Moments.of(begun_in_the_air).times[:4] == [0.0, 1.0, 1.5, 2.0]  # the body moves from knot 1 on
    footing = Footing(problem, masks.grid)
    series = moments.masks(masks, footing)
    for i, (time, grippers) in enumerate(zip(moments.times, moments.grippers, strict=True)):
        between = (schedule.poses[int(time)] + schedule.poses[int(np.ceil(time))]) / 2
        np.testing.assert_allclose(grippers, between[:, :4])
        for limb in range(4):
            assert not (series[i] & ~masks.held(limb, grippers[limb])).any()
    half = moments.times.index(flown[len(flown) // 2] + 0.5)
    series[half] = np.zeros_like(series[half])
    assert pose_path(problem, masks, series, None, moments.times) == (None, half)


def test_halves_of_a_knot_let_the_body_go_as_far_as_the_knot() -> None:
    found = search()
    problem, masks = found.problem, found.masks
    step = 0.95 * problem.body.max_speed_m_s * problem.dt_s
    turn = 0.9 * problem.body.max_rate_rad_s * problem.dt_s
    for cells in (1, 3, 4):  # of the grid, in a knot
        grid = BodyGrid(
            yaw_rad=np.array([turn / cells * i for i in range(13)]),
            roll_rad=np.zeros(1),
            pitch_rad=np.zeros(1),
            z_m=np.array([problem.start.position_m[2]]),
            x_m=step / cells * np.arange(30) + problem.start.position_m[0],
            y_m=problem.start.position_m[1:2],
        )
        goal = np.zeros(grid.shape, dtype=bool)
        goal[3 * cells, ..., 3 * cells, 0] = True  # in the three steps after the first knot, and no fewer
        masks = SimpleNamespace(grid=grid, goal=goal)  # type: ignore[assignment]
        times = [0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0]
        all_of = [np.ones(grid.shape, dtype=bool) for _ in times]
        cells_on_way, _ = pose_path(problem, masks, all_of, None, times)
        assert cells_on_way is not None
        assert len(cells_on_way) == len(times) - 2
        assert cells_on_way[-1][4] == 3 * cells
        goal[:] = False
        goal[0, ..., 3 * cells + 1, 0] = True
        assert pose_path(problem, masks, all_of, None, times)[0] is None


def test_what_is_looked_at_is_counted() -> None:
    assert search().find((), 2, np.inf) is None


def test_links_are_looked_at_where_a_mask_asks_for_it(robot: Robot) -> None:
    """Part by part as all at once."""
    problem, grid = search().problem, search().masks.grid
    whole, parts = (PoseMasks(problem, robot, grid, 0.04) for _ in range(2))
    grippers = [whole.at(c) for c in problem.start_contacts]
    grippers[0], grippers[2] = (0.08, 0.35, 0.04, 0.63), (0.08, 0.22, 0.1, 1.28)  # one behind the other
    mask = np.logical_and.reduce([whole.held(limb, there) for limb, there in enumerate(grippers)])
    expected = whole.apart(mask, grippers)
    assert 0 < expected.sum() < mask.sum()
    some = np.random.default_rng(0).random(mask.shape) < 0.5
    parts.apart(mask & some, grippers)
    np.testing.assert_array_equal(parts.apart(mask, grippers), expected)


def test_masks_grow_by_a_cell_each_way() -> None:
    mask = np.zeros((3, 1, 1, 1, 5, 5), dtype=bool)
    mask[1, 0, 0, 0, 0, 2] = True
    expected = np.zeros_like(mask)
    expected[:, 0, 0, 0, 0:2, 1:4] = True
    np.testing.assert_array_equal(grown(mask), expected)


def cheapest(masks: PoseMasks, knots: list[Flags], grid: BodyGrid) -> float:
    """Cost of the best way through the knots, cell by cell and pair by pair."""
    problem, weights, goal = masks.problem, masks.problem.weights, masks.problem.goal.body
    cells = list(itertools.product(*(range(n) for n in grid.shape)))
    poses = np.array([np.concatenate(grid.pose(cell)) for cell in cells])
    way = poses[:, None] - poses[None]
    step, turn = 0.95 * problem.body.max_speed_m_s * problem.dt_s, 0.9 * problem.body.max_rate_rad_s * problem.dt_s
    allowed = (np.abs(way) <= np.array([step] * 3 + [turn] * 3) + 1e-9).all(axis=-1)
    moved = np.where(allowed, weights.velocity / problem.dt_s**2 * (way**2).sum(axis=-1), np.inf)
    here = weights.position * ((poses[:, :3] - goal.position_m) ** 2).sum(axis=1)
    here += weights.orientation * ((poses[:, 3:] - goal.rpy_rad) ** 2).sum(axis=1)
    value = np.where((masks.goal & knots[-1]).ravel(), 0.0, np.inf)
    for mask in knots[-2:1:-1]:
        value = np.where(mask.ravel(), here + (moved + value).min(axis=1), np.inf)
    begun = np.abs(poses - [*problem.start.position_m, 0.0, 0.0, 0.0])
    within = (begun <= np.array([step] * 3 + [turn] * 3) + 1e-9).all(axis=1)
    return float((value + weights.velocity / problem.dt_s**2 * (begun**2).sum(axis=1))[within].min())


@pytest.mark.parametrize("seed", range(6))
def test_the_path_is_the_cheapest(robot: Robot, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    monkeypatch.setattr("crux_planner.search.pose_path._EDGE_COST", 0.0)
    problem, random = search().problem, np.random.default_rng(seed)
    grid = BodyGrid(
        yaw_rad=np.array([0.0, 0.03]),
        roll_rad=np.zeros(1),
        pitch_rad=np.array([-0.03, 0.0]),
        z_m=np.array([0.185]),
        x_m=np.linspace(0.0, 0.15, 9),
        y_m=np.linspace(-0.03, 0.03, 4),
    )
    masks = PoseMasks(problem, robot, grid, 0.04)
    goal = np.argwhere(masks.goal)[0]
    knots = [random.random(grid.shape) < 0.75 for _ in range(10)]
    knots[-1][tuple(goal)] = True
    wanted = cheapest(masks, knots, grid)
    path, _ = pose_path(problem, masks, knots)
    assert (path is None) == np.isinf(wanted)
    if path is None:
        return
    assert all(knot[cell] for cell, knot in zip(path, knots[2:], strict=True))
    only = [np.zeros_like(knot) for knot in knots]
    for cell, knot in zip(path, only[2:], strict=True):
        knot[cell] = True
    assert cheapest(masks, only, grid) == pytest.approx(wanted)


def test_where_the_body_follows_surfaces_it_goes_up_and_tilts(robot: Robot) -> None:
    """From plane to plane over an edge of 60 degrees; what is said to be in balance at a height is."""
    scene = edge(*CONVEX_60)
    for end, tilt_deg in (("start", -30.0), ("goal", 20.0)):
        scene[end]["body"]["rpy_deg"] = [0.0, tilt_deg, 0.0]
    problem = build_problem(scenario(scene), robot).aimed()
    grid = grid_about(problem, 0.03, 0.07, 0.16, 0.0)
    ends = np.degrees(grid.pitch_rad[[0, -1]])
    assert ends[0] == pytest.approx(-30.0)
    assert 20.0 <= ends[1] <= 30.0
    assert np.abs(np.degrees(grid.pitch_rad) - 20.0).min() < 1e-9
    assert np.diff(grid.pitch_rad).max() < 0.0701
    assert grid.z_m[[0, -1]] == pytest.approx([0.185 - 0.09, 0.185 + 0.09])
    footing, held = Footing(problem, grid), (*problem.start_contacts[:3], None)
    support = problem.start_contacts[:3]
    stands = footing.stands(held, footing.oracle.mean_place(support))
    assert stands is not None
    assert stands[..., 0, :, :].any()
    for z, x, y in np.argwhere(stands[0, 0, 0])[::7]:
        at = np.array([grid.x_m[x], grid.y_m[y], grid.z_m[z]])
        assert footing.oracle.by_friction(support, at, at, at) is not None


def tilting() -> MapSearch:
    """Over an edge of 60 degrees, from a level body to a level one."""
    robot = load_robot("scaler")
    problem = replace(build_problem(scenario(edge(*CONVEX_60)), robot).aimed(), follows=True)
    grid = grid_about(problem, 0.03, 0.07, 0.16, 0.0)
    return MapSearch(PoseMasks(problem, robot, grid, 0.04), Footing(problem, grid), SwingCache(problem))


@pytest.mark.parametrize("air", [0, 2])
def test_motors_are_as_strong_as_blocks_of_tilted_poses_say(air: int) -> None:
    """What a body can carry is not the same at every tilt and height."""
    found = tilting()
    footing, start = found.footing, found.problem.start_contacts
    held = tuple(c if limb != air else None for limb, c in enumerate(start))
    mask = found.masks.hold(held)
    mask[..., 5:] = False
    cells = np.random.default_rng(0).permutation(np.argwhere(mask))[:80]
    ok = np.array([footing.strong_at(held, start, tuple(cell)) for cell in cells.tolist()])
    near = tuple(cells[np.flatnonzero(ok)[0]].tolist())
    strong = footing.strong(held, start, mask, near)
    assert not (strong & ~mask).any()
    assert 0.1 < ok.mean() < 0.9
    assert (strong[tuple(cells.T)] == ok).mean() > 0.85
    weak = footing.weak_about(held, start, mask, tuple(cells[np.flatnonzero(~ok)[0]].tolist()))
    assert [footing.strong_at(held, start, tuple(cell)) for cell in np.argwhere(weak & mask).tolist()].count(True) == 0


def test_swings_of_a_body_that_tilts_are_where_motors_hold_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """At a sample of every swing on a way that is found, some pose of the body; none where they hold nowhere."""
    assert tilting().find((), 60, np.inf) is not None
    monkeypatch.setattr(Footing, "strong_blocks", lambda _self, _held, _stance, mask: np.zeros_like(mask))
    assert tilting().find((), 60, np.inf) is None


def test_where_there_is_no_way_the_knot_is_named(robot: Robot) -> None:
    problem = search().problem
    masks = PoseMasks(problem, robot, grid_about(problem, 0.03, 0.07, 0.05, 0.07), 0.04)
    knots = [np.ones(masks.grid.shape, dtype=bool) for _ in range(12)]
    knots[5] = np.zeros_like(knots[5])
    assert pose_path(problem, masks, knots) == (None, 5)


def far_search() -> MapSearch:
    """A long ladder: its rungs are one hop apart, and the goal many."""
    robot = load_robot("scaler")
    problem = build_problem(scenario(ladder(12)), robot).aimed()
    grid = grid_about(problem, 0.02, 0.07, 0.2, 0.2)
    return MapSearch(PoseMasks(problem, robot, grid, 0.04), Footing(problem, grid), SwingCache(problem))


def test_a_far_goal_is_found_with_few_looks_at_moves() -> None:
    found = far_search()
    way = found.find((), 100, np.inf)
    assert way is not None
    assert (found.goals == way[-1][2]).all(axis=1).any()


def test_what_is_ahead_is_the_shortest_way_of_each_limb() -> None:
    """As another library has it, of all hops there are."""
    found, ahead = far_search(), 0.0
    problem, masks, swings = found.problem, found.masks, found.swings
    for limb, start in enumerate(problem.start_contacts):
        mine = sorted({start, *problem.limb_contacts[limb]})
        hops = np.zeros((len(mine), len(mine)))
        for i, j in itertools.permutations(range(len(mine)), 2):
            if (masks.held(limb, masks.at(mine[i])) & masks.held(limb, masks.at(mine[j]))).any():
                way = swings.swing(mine[i], mine[j])
                hops[i, j] = 0.0 if way is None else way.intervals + 1.2
        ends = [mine.index(c) for c in np.unique(found.goals[:, limb]).tolist()]
        ahead += dijkstra(hops.T, indices=ends, min_only=True)[mine.index(start)]
    assert found.ahead(problem.start_contacts) == pytest.approx(ahead)


def test_limbs_keep_off_one_another_while_one_swings(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that stay as well: a move is not found where their links would meet."""
    found = far_search()
    start, limb = found.problem.start_contacts, 0
    swings = [s for part in np.unique(found._parts(start))[1:] for s in found._swings((start, int(part)))]
    open_to = [s for s in swings if s.limb == limb and found._landed(s)]
    assert open_to
    asked = []

    def apart(mask: Flags, grippers: list[object], _moving: tuple[int, ...] = ()) -> Flags:
        asked.append([i for i, at in enumerate(grippers) if at is not None])
        return mask if len(asked[-1]) == 4 else np.zeros_like(mask)  # as if the limbs that stay met

    monkeypatch.setattr(found.masks, "apart", apart)
    assert not found._landed(open_to[0])
    assert [1, 2, 3] in asked


def test_links_of_limbs_without_a_gripper_are_left_out() -> None:
    masks = search().masks
    grippers = [masks.at(c) for c in search().problem.start_contacts]
    grippers[0], grippers[2] = (0.08, 0.35, 0.04, 0.63), (0.08, 0.22, 0.1, 1.28)  # one behind the other
    mask = np.logical_and.reduce([masks.held(limb, there) for limb, there in enumerate(grippers)])
    assert (masks.apart(mask, grippers) != mask).any()
    np.testing.assert_array_equal(masks.apart(mask, [None, *grippers[1:]]), mask)


def test_what_wrenches_add_to_the_cost_is_that_of_the_least() -> None:
    footing = search().footing
    problem, oracle, grid = footing.problem, footing.oracle, footing.grid
    start = problem.start_contacts
    held, middle = (None, *start[1:]), oracle.mean_place(start)
    carried = np.broadcast_to(footing.carried(held, middle), grid.shape[3:])
    effort = np.tile(oracle.effort, 3)
    maps = np.concatenate(oracle.maps[sorted(start[1:])], axis=1)
    for cell in ((0, 0, 0), (0, 3, 5), (0, 7, 1)):
        place, _ = grid.pose((0, 0, 0, *cell))
        body, right = oracle.weight(middle)
        least = np.linalg.lstsq(maps / effort, right - body @ place, rcond=None)[0]
        assert carried[cell] == pytest.approx(problem.weights.wrench * float(least @ least))


def test_the_body_keeps_where_motors_hold_it() -> None:
    """With weak ones, the path goes elsewhere; with weaker ones it ends where no place is left."""
    found = search()
    problem, masks = found.problem, found.masks
    way = found.find((), 500, np.inf)
    assert way is not None
    moves = [Move(before, after, (limb,), *[problem.start.position_m] * 2) for before, limb, after in way]
    air = np.array([found.swings.intervals(before[limb], after[limb]) for before, limb, after in way])
    stances = np.full(len(moves) + 1, 3)
    problem = replace(problem, steps=int(stances.sum() + air.sum()))
    schedule = at_knots(problem, found.swings, moves, stances, air)
    strong = clear_path(problem, masks, Footing(problem, masks.grid), schedule)
    assert not isinstance(strong, Ended)
    weak = Footing(problem, masks.grid)
    weak.oracle = weak.oracle.within(0.2 * problem.last_torques_Nm)
    ended = clear_path(problem, masks, weak, schedule)
    assert isinstance(ended, Ended)
    assert ended.by_places
    weak = Footing(problem, masks.grid)
    weak.oracle = weak.oracle.within(0.62 * problem.last_torques_Nm)
    path = clear_path(problem, masks, weak, schedule)
    assert not isinstance(path, Ended)
    stood = [k for k, knot in enumerate(schedule.contacts) if None not in knot]

    def too_weak(poses: Array) -> list[int]:
        found = []
        for k in (k for k, knot in enumerate(schedule.contacts) if None in knot and not poses[k, 3:].any()):
            nearest = schedule.contacts[min(stood, key=lambda at: abs(at - k))]
            grippers = tuple(c for c in nearest if c is not None)
            if not weak.oracle.hold(tuple(schedule.contacts[k]), poses[k, :3], grippers):
                found.append(k)
        return found

    assert len(too_weak(strong)) > 3
    assert not too_weak(path)
