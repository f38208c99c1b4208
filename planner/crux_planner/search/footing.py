"""Sets of body poses that balance, and in which motors hold the body."""

from __future__ import annotations

import bisect

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem, turned_problem
from crux_planner.model.schedule import Contacts
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.search.pose_masks import TURN_M, grown
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers.hull import sides_of

_DIRECTIONS = np.linspace(0.0, 2 * np.pi, 12, endpoint=False)  # in which the farthest places in balance are looked for
_FAR_M, _BEYOND_M = 2.0, 0.3  # off the grippers' middle, and the grid
_LOOKS, _NEAREST = 16, 6  # at poses of a set for one that motors hold; of these the nearest to the grippers' middle
_BLOCK = 2  # cells along each axis that share whether motors hold a body that tilts
_HEIGHTS = 3  # of a grid that share what balances at the highest of them


class Footing:
    """Where a body balances on some contacts, as friction has it, about as a level one does, and whether motors hold it
    there.
    """

    def __init__(self, problem: Problem, grid: BodyGrid) -> None:
        self.problem, self.grid = problem, grid
        self.oracle = TorqueLimits(problem, problem.friction_share, problem.last_torques_Nm)
        self._sides: dict[tuple[tuple[int, ...], float], Array | None] = {}
        self._turned: dict[tuple[int, ...], TorqueLimits] = {}
        self._strong: dict[tuple[object, ...], bool] = {}
        self._blocks: dict[tuple[object, ...], dict[int, bool]] = {}
        self._random = np.random.default_rng(0)

    def stands(self, held: Contacts, grippers_m: Array) -> Flags | None:
        """A mask that broadcasts to the grid's: inside the polygons of the farthest places along some directions, each
        at the highest of some heights, the body's heading and tilt left out; `grippers_m` (3,) is the mean place of all
        grippers. None if there is no place.
        """
        support, grid = tuple(sorted(c for c in held if c is not None)), self.grid
        moved, _ = self.oracle.centre(grippers_m)
        carried = (np.eye(3) - moved) @ (self.oracle.mean_place(support) - grippers_m)
        off = np.linalg.solve(moved, carried)[:2]
        places = np.stack(np.meshgrid(grid.x_m, grid.y_m, indexing="ij"), axis=-1) - off
        found = np.zeros((1, 1, 1, *grid.shape[3:]), dtype=bool)
        for top in range(len(grid.z_m) - 1, -1, -_HEIGHTS):
            key = support, float(grid.z_m[top])
            if key not in self._sides:
                self._sides[key] = self._polygon(*key)
            if (sides := self._sides[key]) is not None:
                inside = (places @ sides[:, :2].T + sides[:, 2] <= 1e-6).all(axis=-1)
                found[0, 0, 0, max(0, top + 1 - _HEIGHTS) : top + 1] = inside
        return found if found.any() else None

    def held_at(self, held: Contacts, grippers: tuple[int, ...], mask: Flags) -> bool:
        """Whether motors hold the body at some pose of a mask, those looked at that are likeliest to do; where the
        body tilts, all blocks.
        """
        cells, grid = np.argwhere(mask), self.grid
        middle = self.oracle.mean_place(tuple(c for c in held if c is not None))
        way = np.hypot(grid.x_m[cells[:, 4]] - middle[0], grid.y_m[cells[:, 5]] - middle[1])
        order = np.argsort(way + TURN_M * np.abs(grid.yaw_rad[cells[:, 0]]), kind="stable")
        others = self._random.permutation(order[_NEAREST:])[: _LOOKS - _NEAREST]
        looks = [*order[:_NEAREST], *others]
        if any(self.strong_at(held, grippers, tuple(map(int, cells[j]))) for j in looks):
            return True
        return self.grid.tilts and bool(self.strong_blocks(held, grippers, mask).any())

    def carried(self, held: Contacts, grippers_m: Array) -> Array:
        """What the wrenches of least norm add to J at one knot, (z, x, y) of the grid."""
        support, oracle, grid = tuple(sorted(c for c in held if c is not None)), self.oracle, self.grid
        least, effort = oracle.least_norm(support), np.tile(oracle.effort, len(oracle.bearing(support)))
        body, right = oracle.weight(grippers_m)
        slope, still = effort[:, None] * (least @ body), effort * (least @ right)
        square, linear = slope.T @ slope, slope.T @ still
        z, x, y = np.ix_(grid.z_m, grid.x_m, grid.y_m)
        at = {0: x, 1: y, 2: z}
        found = sum(square[i, j] * at[i] * at[j] for i in at for j in at) - 2 * sum(linear[i] * at[i] for i in at)
        return np.asarray(self.problem.weights.wrench * (found + still @ still))

    def strong(self, held: Contacts, grippers: tuple[int, ...], mask: Flags, near: tuple[int, ...]) -> Flags:
        """The part of a mask at which motors hold the body, about. Where it tilts, blocks of cells are as one of them
        is; else inside the polygon of the farthest cells, along some directions: turned and as high as a cell, or as
        near to that as some are.
        """
        grid, middle = self.grid, self.oracle.mean_place(tuple(c for c in held if c is not None))
        if grid.tilts:
            return self.strong_blocks(held, grippers, mask)
        turns = np.argwhere(mask.any(axis=(4, 5)))
        for turn in turns[np.argsort(np.abs(turns - near[:4]).sum(axis=1), kind="stable")]:
            cells = np.argwhere(mask[tuple(turn)])
            cells = cells[np.argsort(np.hypot(grid.x_m[cells[:, 0]] - middle[0], grid.y_m[cells[:, 1]] - middle[1]))]
            at = np.column_stack([np.tile(turn, (len(cells), 1)), cells])
            begun = next(
                (cell for cell in at[:_NEAREST] if self.strong_at(held, grippers, tuple(map(int, cell)))), None
            )
            if begun is not None:
                return np.asarray(mask & self._inside(held, grippers, at, begun))
        return np.zeros_like(mask)

    def strong_blocks(self, held: Contacts, grippers: tuple[int, ...], mask: Flags) -> Flags:
        """The part of a mask at which motors hold the body, by blocks of cells that are as the first one asked for."""
        cells, found = np.argwhere(mask), np.zeros_like(mask)
        sizes = tuple(-(-count // _BLOCK) for count in mask.shape)
        numbers = np.ravel_multi_index(tuple((cells // _BLOCK).T), sizes)
        blocks, first, which = np.unique(numbers, return_index=True, return_inverse=True)
        known = self._blocks.setdefault((held, grippers), {})
        for block, cell in zip(blocks.tolist(), cells[first].tolist(), strict=True):
            if block not in known:
                known[block] = self.strong_at(held, grippers, tuple(cell))
        found[tuple(cells.T)] = np.array([known[block] for block in blocks.tolist()], dtype=bool)[which]
        return found

    def weak_about(self, held: Contacts, grippers: tuple[int, ...], mask: Flags, cell: tuple[int, ...]) -> Flags:
        """The cells about one at which motors are too weak that are left out with it: where the body tilts those of a
        mask that are as weak, else all.
        """
        here = np.zeros_like(mask)
        here[cell] = True
        about = grown(here)
        if self.grid.tilts:
            for other in np.argwhere(about & mask).tolist():
                about[tuple(other)] = not self.strong_at(held, grippers, tuple(other))
        return about

    def _inside(self, held: Contacts, grippers: tuple[int, ...], cells: Indices, begun: Indices) -> Flags:
        """(x, y) inside the polygon of the farthest of the cells (n, 6) around one at which motors hold the body."""

        def farthest(ray: Indices) -> Indices:
            def weak(i: int) -> bool:
                return not self.strong_at(held, grippers, tuple(map(int, ray[i])))

            count = bisect.bisect_left(range(len(ray)), True, key=weak)
            return np.asarray(ray[count - 1] if count else begun)

        ends, way = [begun[4:]], (cells - begun)[:, 4:]
        for angle in _DIRECTIONS:
            along, off = way @ [np.cos(angle), np.sin(angle)], way @ [-np.sin(angle), np.cos(angle)]
            on = np.flatnonzero((along > 0.0) & (np.abs(off) <= 0.5))
            ends.append(farthest(cells[on[np.argsort(along[on])]])[4:])
        places = np.stack(np.meshgrid(*map(np.arange, self.grid.shape[4:]), indexing="ij"), axis=-1)
        if (sides := sides_of(np.array(ends, dtype=float))) is None:
            return np.asarray((places == begun[4:]).all(axis=-1))
        return np.asarray((places @ sides[:, :2].T + sides[:, 2] <= 1e-6).all(axis=-1))

    def strong_at(self, held: Contacts, grippers: tuple[int, ...], cell: tuple[int, ...]) -> bool:
        """Whether motors hold the body there."""
        key = held, grippers, cell
        if key not in self._strong:
            place, rpy = self.grid.pose(cell)
            if cell[:3] not in self._turned:
                self._turned[cell[:3]] = self.oracle.turned(turned_problem(self.problem, rpy))
            self._strong[key] = self._turned[cell[:3]].hold(held, rotation_from_rpy(rpy).T @ place, grippers)
        return self._strong[key]

    def _polygon(self, support: tuple[int, ...], z_m: float) -> Array | None:
        """Sides (n, 3) of the places in balance at a height whose grippers' mean place is the support's."""
        grid, middle, points = self.grid, self.oracle.mean_place(support), []
        low = np.array([grid.x_m[0] - _BEYOND_M, grid.y_m[0] - _BEYOND_M, z_m])
        high = np.array([grid.x_m[-1] + _BEYOND_M, grid.y_m[-1] + _BEYOND_M, z_m])
        for angle in _DIRECTIONS:
            far = middle[:2] + _FAR_M * np.array([np.cos(angle), np.sin(angle)])
            at = self.oracle.by_friction(support, low, high, np.append(far, z_m))
            if at is None:
                return None
            points.append(at[:2])
        return sides_of(np.array(points))
