"""P2a, equation (19a) at the first iteration, in the paper's form as it stands, given to HiGHS: a yardstick, no method.

Binaries alpha (finger i on face c), beta (finger i outside face h of obstacle v), gamma (sign of m^z), one each a knot;
big-M rows for (10), (12), (14); one rotation matrix, the level one, in (9a); forces by (8a), no moments (8b). HiGHS has
no mixed-integer quadratic programs, so every square of (6) is a variable above tangents: what is minimised is below
J, and so are its bounds. |z_next - z|^2 is |z_next - z|, for z is 0 or 1.

    python -m crux_planner.admm.paper_form SCENARIO [--time-limit S] --json
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import highspy
import numpy as np
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_contracts.terminal import say

from crux_planner.admm.paper_scene import PaperScene, paper_scene
from crux_planner.model.arrays import Array, Indices
from crux_planner.solvers.milp import Milp

_BESIDE_M = 0.6  # how far beyond the outermost face a finger or the body may be
_TANGENTS = np.array([-0.9, -0.5, -0.2, 0.0, 0.2, 0.5, 0.9])  # shares of a variable's bound


class Model(Milp):
    """Variables and rows in blocks, and what the variables cost."""

    def __init__(self) -> None:
        super().__init__()
        self._costs: list[Array] = []

    def block(self, shape: tuple[int, ...], low: Any, high: Any, cost: Any = 0.0, *, binary: bool = False) -> Indices:
        """Numbers of new variables, in their shape; bounds and costs broadcast."""
        low, high, cost = (np.broadcast_to(np.asarray(each, dtype=float), shape).ravel() for each in (low, high, cost))
        self._costs.append(cost)
        return self.variables(int(np.prod(shape)), low, high, integer=binary).reshape(shape)

    def squares(self, index: Indices, target: Any, weight: float, bound: Any) -> None:
        """Cost of weight (x - target)^2 by tangents from below; |x - target| is about `bound` at most."""
        target, bound = (np.broadcast_to(np.asarray(v, dtype=float), index.shape) for v in (target, bound))
        square = self.block(index.shape, 0.0, np.inf, weight)
        for share in _TANGENTS:
            d = share * bound
            self.add([(square, 1.0), (index, -2 * d)], -(d**2) - 2 * d * target, np.inf)

    def highs(self) -> highspy.HighsLp:
        """What HiGHS takes."""
        model = self._model()
        model.col_cost_ = np.concatenate(self._costs)
        return model


def build(scene: PaperScene) -> tuple[Model, dict[str, Indices]]:
    """The rows, and the variables by their letters."""
    model, n = Model(), scene.steps
    fingers, faces = len(scene.limb), len(scene.centre)
    x = _body(model, scene)
    far = _far(scene)
    big = 3 * far  # beyond any distance on the wall
    low, high = np.array([-far, -far, 0.0]), np.array([far, far, scene.top_m])
    lift = scene.weights.lift * 4 / fingers
    x["p"] = p = model.block((n + 1, fingers, 3), low, high, np.array([0.0, 0.0, lift]))
    x["alpha"] = alpha = model.block((n + 1, fingers, faces), 0.0, 1.0, binary=True)
    _reach(model, scene, x)
    _ends(model, scene, x)
    # (10a): on the face, and at rest; (10c)
    for axes, extents in ((scene.normal[:, None, :], np.zeros((faces, 1))), (scene.along, scene.half_m)):
        for a in range(axes.shape[1]):
            place = np.einsum("ci,ci->c", axes[:, a], scene.centre)
            terms = [(p[:, :, None, i], axes[:, a, i]) for i in range(3)]
            model.add([*terms, (alpha, big)], -np.inf, place + extents[:, a] + big)
            model.add([*terms, (alpha, -big)], place - extents[:, a] - big, np.inf)
    for sign in (1.0, -1.0):
        both = [(alpha[1:, :, :, None], big), (alpha[:-1, :, :, None], big)]
        model.add([(p[1:, :, None, :], sign), (p[:-1, :, None, :], -sign), *both], -np.inf, 2 * big)
    model.add([(alpha[:, :, c], 1.0) for c in range(faces)], 0.0, 1.0)
    model.add([(p[1:], 1.0), (p[:-1], -1.0)], -scene.step_m, scene.step_m)
    changed = model.block((n, fingers, faces), 0.0, 1.0, scene.weights.switching * 4 / fingers)
    for sign in (1.0, -1.0):
        model.add([(changed, 1.0), (alpha[1:], sign), (alpha[:-1], -sign)], 0.0, np.inf)
    _wrenches(model, scene, x)
    normals, reaches = scene.boxes
    if len(normals):  # (14)
        shape = (n + 1, fingers, *reaches.shape)
        x["beta"] = beta = model.block(shape, 0.0, 1.0, binary=True)
        terms = [(p[:, :, None, None, i], normals[..., i]) for i in range(3)]
        model.add([*terms, (beta, big)], reaches, np.inf)
        model.add([(beta[..., h], 1.0) for h in range(5)], 0.0, 4.0)
    return model, x


def _far(scene: PaperScene) -> float:
    """How far from H's origin anything may be along x and y [m]."""
    places = np.vstack([scene.centre, scene.start_h_m, scene.start.position_m, scene.goal.body.position_m])
    return float(np.abs(places[:, :2]).max()) + _BESIDE_M


def _body(model: Model, scene: PaperScene) -> dict[str, Indices]:
    """r, theta and their rates: bounds (7), explicit Euler, start and goal, and |x - x_g|_Q^2."""
    n, dt, body, goal, weights = scene.steps, scene.dt_s, scene.body, scene.goal, scene.weights
    x: dict[str, Indices] = {}
    far = _far(scene)
    floor, top = np.array([-far, -far, body.height_m[0]]), np.array([far, far, body.height_m[1]])
    tilt = np.array([body.max_tilt_rad, body.max_tilt_rad, np.pi])
    for name, rate, low, high, start, end, slack, weight, fast in (
        ("r", "v", floor, top, scene.start.position_m, goal.body.position_m, goal.position_slack_m, weights.position,
         body.max_speed_m_s),
        ("theta", "omega", -tilt, tilt, scene.start.rpy_rad, goal.body.rpy_rad, goal.rotation_slack_rad,
         weights.orientation, body.max_rate_rad_s),
    ):  # fmt: skip
        lows, highs = np.tile(low, (n + 1, 1)), np.tile(high, (n + 1, 1))
        lows[0] = highs[0] = start
        lows[-1], highs[-1] = np.maximum(low, end - slack), np.minimum(high, end + slack)
        x[name] = model.block((n + 1, 3), lows, highs)
        fastest = np.full((n + 1, 3), fast)
        fastest[[0, -1]] = 0.0
        x[rate] = model.block((n + 1, 3), -fastest, fastest)
        model.add([(x[name][1:], 1.0), (x[name][:-1], -1.0), (x[rate][:-1], -dt)], 0.0, 0.0)
        model.squares(x[name], end, weight, np.abs(start - end) + 0.1)
        model.squares(x[rate], 0.0, weights.velocity, fast)
    return x


def _reach(model: Model, scene: PaperScene, x: dict[str, Indices]) -> None:
    """(9a) at level, (9b)."""
    n, p = scene.steps, x["p"]
    middle, half = scene.reach_b_m, scene.reach_half_m
    own = [np.flatnonzero(scene.limb == limb) for limb in range(4)]
    share = 1.0 / len(own[0])
    for limb, fingers in enumerate(own):
        terms = [(p[1:, i], share) for i in fingers]
        model.add([*terms, (x["r"][1:], -1.0)], middle[limb] - half, middle[limb] + half)
    if len(own[0]) == 2:
        size = np.array([scene.separation_m, scene.separation_m, 0.0])
        opening = np.array([scene.weights.opening, 0.0, 0.0])
        x["d"] = model.block((n + 1, 4, 3), -size, size, opening)
        model.add([(p[:, 0::2], 1.0), (p[:, 1::2], -1.0), (x["d"], -1.0)], 0.0, 0.0)
    x["q"] = model.block((n + 1, 4), -np.pi, np.pi)
    model.add([(x["q"], 1.0), (x["theta"][:, None, 2], -1.0)], *scene.yaw_rad)


def _ends(model: Model, scene: PaperScene, x: dict[str, Indices]) -> None:
    """Where fingers begin and end."""
    p, alpha, fingers = x["p"], x["alpha"], np.arange(len(scene.limb))
    model.add([(p[0], 1.0)], scene.start_h_m, scene.start_h_m)
    model.add([(alpha[0, fingers, scene.start_face], 1.0)], 1.0, 1.0)
    named = np.flatnonzero(scene.end_face >= 0)
    if len(named):
        model.add([(alpha[-1, named, scene.end_face[named]], 1.0)], 1.0, 1.0)
    placed = np.flatnonzero(~np.isnan(scene.end_h_m[:, 0]))
    if len(placed):
        where = scene.end_h_m[placed]
        model.add([(p[-1, placed], 1.0)], where - scene.end_slack_m, where + scene.end_slack_m)


def _wrenches(model: Model, scene: PaperScene, x: dict[str, Indices]) -> None:
    """(8a), (10b), (11) with (3), (12), (13), (4) and |u|_P^2."""
    n, alpha, most = scene.steps, x["alpha"][:-1], scene.largest_N
    fingers, faces = len(scene.limb), len(scene.centre)
    shear = scene.friction * most + scene.spine[:, 0]
    sides = np.stack([-shear, -shear, np.zeros(faces)], axis=1), np.stack([shear, shear, np.full(faces, most)], axis=1)
    x["f"] = f = model.block((n, fingers, faces, 3), *sides)
    reach = float(np.max(shear)) + most
    x["lambda"] = force = model.block((n, fingers, 3), -reach, reach)
    for i in range(3):  # (13)
        terms = [(f[:, :, c, a], -scene.along[c, a, i]) for c in range(faces) for a in (0, 1)]
        terms += [(f[:, :, c, 2], -scene.normal[c, i]) for c in range(faces)]
        model.add([(force[:, :, i], 1.0), *terms], 0.0, 0.0)
    model.squares(force, 0.0, scene.effort, min(reach, 40.0))
    model.add([(f[..., 2], 1.0), (alpha, -most)], -np.inf, 0.0)  # (10b)
    if scene.k_m > 0.0:
        twist = scene.k_m * scene.friction * most + scene.spine[:, 1]
        x["m"] = m = model.block((n, fingers, faces), -twist, twist)
        x["gamma"] = gamma = model.block((n, fingers, faces), 0.0, 1.0, binary=True)
        model.squares(m, 0.0, scene.effort / scene.k_m**2, twist)
        model.add([(m, 1.0), (gamma, -twist)], -np.inf, 0.0)
        model.add([(m, 1.0), (gamma, -twist)], -twist, np.inf)
        for sign in (1.0, -1.0):
            rows = [(m, sign), (f[..., 2], -scene.k_m * scene.friction), (alpha, -scene.spine[:, 1])]
            model.add(rows, -np.inf, 0.0)
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            rows = [(f[..., axis], sign), (f[..., 2], -scene.friction), (alpha, -scene.spine[:, 0])]
            if scene.k_m == 0.0:
                model.add(rows, -np.inf, 0.0)
                continue
            big = 2 * twist / scene.k_m
            model.add([*rows, (m, 1 / scene.k_m), (gamma, big)], -np.inf, big + scene.spine[:, 1] / scene.k_m)
            model.add([*rows, (m, -1 / scene.k_m), (gamma, -big)], -np.inf, scene.spine[:, 1] / scene.k_m)
    for c in np.flatnonzero(scene.opposite >= 0):  # (4)
        model.add([(f[:, 0::2, c, :2], 1.0), (f[:, 1::2, scene.opposite[c], :2], -1.0)], 0.0, 0.0)
    weight, step = scene.mass_kg * scene.gravity_h, scene.mass_kg / scene.dt_s
    terms = [(force[:, i], -1.0) for i in range(fingers)]
    model.add([(x["v"][1:], step), (x["v"][:-1], -step), *terms], weight, weight)


def solve(scene: PaperScene, time_limit_s: float, gap: float = 1e-4) -> dict[str, Any]:
    """Build, solve until the gap is closed to this share or the time is up, and say how far HiGHS came."""
    began = time.monotonic()
    model, _ = build(scene)
    solver = highspy.Highs()  # type: ignore[no-untyped-call]
    solver.setOptionValue("output_flag", False)
    solver.setOptionValue("mip_rel_gap", gap)
    solver.passModel(model.highs())
    built = time.monotonic() - began
    solver.setOptionValue("time_limit", max(time_limit_s - built, 1.0))
    solver.run()
    info = solver.getInfo()
    found = info.primal_solution_status == highspy.SolutionStatus.kSolutionStatusFeasible
    bound = float(info.mip_dual_bound)
    return {
        "ok": bool(found),
        "rows": model.rows,
        "columns": model.size,
        "binaries": model.binaries,
        "incumbent": float(info.objective_function_value) if found else None,
        "bound": bound if np.isfinite(bound) else None,
        "nodes": int(info.mip_node_count),
        "status": solver.modelStatusToString(solver.getModelStatus()),
        "built_s": round(built, 3),
        "seconds": round(time.monotonic() - began, 3),
    }


def main() -> int:
    """The command of the docstring; exit status 0 when values were found."""
    parser = argparse.ArgumentParser(description="P2a in the paper's form, in HiGHS.")
    parser.add_argument("scenario", type=Path)
    parser.add_argument("--time-limit", type=float, default=60.0, metavar="S")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    scenario = load_scenario(options.scenario)
    said = solve(paper_scene(scenario, load_robot(scenario.robot)), options.time_limit)
    incumbent = "no values" if said["incumbent"] is None else f"values at {said['incumbent']:.3f}"
    proven = "none" if said["bound"] is None else f"{said['bound']:.3f}"
    said["remark"] = (
        f"{said['rows']} rows, {said['binaries']} binaries: {incumbent}, bound {proven}, {said['status'].lower()}"
    )
    say(json.dumps(said) if options.json else said["remark"])
    return 0 if said["ok"] else 1


if __name__ == "__main__":
    raise SystemExit(main())
