"""P2a in the paper's form: its size, its squares, and values that HiGHS finds where the problem is small."""

from __future__ import annotations

from pathlib import Path

import highspy
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.admm.paper_form import Model, build, solve
from crux_planner.admm.paper_scene import paper_scene
from scenes import wall

WALK = (Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "walk-flat.yaml").read_text()
ROBOT = load_robot("scaler")


def test_binaries_are_counted_as_the_paper_counts_them() -> None:
    """One alpha a finger, face and knot, one beta a finger, obstacle, its face and knot, one gamma like alpha."""
    scene = paper_scene(parse_scenario(wall(4)), ROBOT)
    model, x = build(scene)
    fingers, faces, obstacles, knots = 8, 40, 8, 5
    assert x["alpha"].shape == (knots, fingers, faces)
    assert x["beta"].shape == (knots, fingers, obstacles, 5)
    assert x["gamma"].shape == (knots - 1, fingers, faces)
    assert model.binaries == sum(x[name].size for name in ("alpha", "beta", "gamma"))


def test_the_start_lies_on_its_faces() -> None:
    """Fingers of the start, and nothing else, satisfy the rows of (10a) and (14) at knot 0."""
    scene = paper_scene(parse_scenario(wall(4)), ROBOT)
    off = np.einsum("ij,ij->i", scene.normal[scene.start_face], scene.start_h_m - scene.centre[scene.start_face])
    np.testing.assert_allclose(off, 0.0, atol=1e-9)
    aside = np.einsum("iaj,ij->ia", scene.along[scene.start_face], scene.start_h_m - scene.centre[scene.start_face])
    assert (np.abs(aside) <= scene.half_m[scene.start_face] + 1e-9).all()
    normals, reaches = scene.boxes
    beyond = np.einsum("vhj,ij->ivh", normals, scene.start_h_m) - reaches
    assert (beyond.max(axis=2) >= -1e-9).all()


def test_tangents_stay_below_squares() -> None:
    model = Model()
    x = model.block((3,), [0.3, -0.7, 1.0], [0.3, -0.7, 1.0])
    model.squares(x, 0.1, 2.0, 1.0)
    solver = highspy.Highs()  # type: ignore[no-untyped-call]
    solver.setOptionValue("output_flag", False)
    solver.passModel(model.highs())
    solver.run()
    cost = solver.getInfo().objective_function_value
    true = 2.0 * ((np.array([0.3, -0.7, 1.0]) - 0.1) ** 2).sum()
    assert 0.8 * true < cost <= true


def test_a_walk_has_values_and_a_bound_below_them() -> None:
    said = solve(paper_scene(parse_scenario(WALK), ROBOT), 60.0, gap=0.1)
    assert said["ok"]
    assert said["binaries"] == 41 * 4
    assert 0.9 * said["incumbent"] <= said["bound"] <= said["incumbent"]
    assert said["incumbent"] == pytest.approx(5.3, abs=0.6)
