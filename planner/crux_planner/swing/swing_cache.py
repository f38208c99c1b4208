"""Which swings exist and which of them other grippers leave free; everything computed once and kept."""

from collections.abc import Iterator

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation

from crux_planner.model.arrays import Array
from crux_planner.model.hands import TILTED
from crux_planner.model.problem import Problem
from crux_planner.swing.swing import Swing, footprint, gripper_gap, palm_gap, palms, plan_swing

_NO_WAY_M = 1e-6
_CORNER_SHARE = 0.5  # of the clearance among grippers, at the corners of palms that are turned against each other


class SwingCache:
    """The swings of one problem; contacts are indices into `problem.contacts`."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self._skipped: dict[tuple[int, int], int] = {}
        self._swings: dict[tuple[int, int], Swing | None] = {}
        self._columns: dict[tuple[int, int], Array] = {}
        self._gaps: dict[tuple[int, int, int], bool] = {}
        shape = problem.shape
        poses = np.stack([c.pose for c in problem.contacts])
        widest = max(c.separation_m / 2 for c in problem.contacts)
        self._standing = self._footprints(poses, shape.half_length(widest) - shape.pad_radius)[:, None]  # of one each
        self._touching = 2 * shape.pad_radius + problem.swing.body_clearance_m

    def swing(self, start: int, end: int) -> Swing | None:
        """The way from one contact to another, None where there is none."""
        key = (start, end)
        if key not in self._swings:
            problem, body = self.problem, (self.problem.start, self.problem.goal.body)
            a, b = problem.contacts[start], problem.contacts[end]
            line, skip = np.stack([pose.position_m[:2] for pose in body]), self._skipped.get(key, 0)
            given = a, b, problem.cuboids, problem.shape, problem.swing
            there = start != end and b.bears
            self._swings[key] = plan_swing(*given, body_line_h_m=line, skip=skip) if there else None
        return self._swings[key]

    def intervals(self, start: int, end: int) -> int:
        """Least knot intervals of an existing way."""
        return self.way(start, end).intervals

    def way(self, start: int, end: int) -> Swing:
        """An existing way."""
        swing = self.swing(start, end)
        assert swing is not None
        return swing

    def exist(self, moves: list[tuple[int, int]], support: tuple[int, ...]) -> bool:
        """Whether there are ways for all `moves`, which end on different holds that those of `support` leave free."""
        contacts = self.problem.contacts
        holds = [contacts[c].hold for c in support] + [contacts[end].hold for _, end in moves]
        return len(set(holds)) == len(holds) and all(self.swing(*move) is not None for move in moves)

    def free(self, moves: list[tuple[int, int]], support: tuple[int, ...]) -> bool:
        """Whether all `moves` exist, end on different free holds, and keep clear of the grippers on `support`."""
        if not self.exist(moves, support):
            return False
        if not all(self._clear(move, c) for move in moves for c in support):
            return False
        if len(moves) == 2:  # two grippers in the air at once keep clear wherever each of them is
            return self._apart(self._column(moves[0]), self._column(moves[1]))
        return True

    def apart(self, standing: int, other: int) -> bool:
        """Whether grippers on two contacts keep clear of each other."""
        return self._apart(self._standing[standing], self._standing[other])

    @property
    def any_forbidden(self) -> bool:
        """Whether some way was found wrong."""
        return bool(self._skipped)

    def forbid(self, start: int, end: int) -> None:
        """Never use this way from one contact to the other again; the next best takes its place, if there is one."""
        self.pass_over(start, end, self.passed_over(start, end) + 1)

    def passed_over(self, start: int, end: int) -> int:
        """How many of the best ways from one contact to another are left out."""
        return self._skipped.get((start, end), 0)

    def pass_over(self, start: int, end: int, best: int) -> None:
        """Leave out that many of the best ways from one contact to another."""
        self._skipped[start, end] = best
        self._forget((start, end))

    def allow_all(self) -> None:
        """Forget what was forbidden."""
        for move in self._skipped:
            self._forget(move)
        self._skipped.clear()

    def _forget(self, move: tuple[int, int]) -> None:
        self._swings.pop(move, None)
        self._columns.pop(move, None)
        for key in [key for key in self._gaps if key[:2] == move]:
            del self._gaps[key]

    def _clear(self, move: tuple[int, int], standing: int) -> bool:
        key = (*move, standing)
        if key not in self._gaps:
            self._gaps[key] = self._apart(self._column(move), self._standing[standing])
        return self._gaps[key]

    def _apart(self, a: Array, b: Array) -> bool:
        """Whether footprints (n, 1 or 2, 9, 3) and (m, …) keep clear: nothing is farther apart than it is seen to be,
        so one direction in which they are seen apart is enough.
        """
        return any(self._seen_apart(a @ view, b @ view) for view in _views(a, b))

    def _seen_apart(self, a: Array, b: Array) -> bool:
        """Whether they are apart in plan view: as capsules, and as the rectangles that palms are."""
        if gripper_gap(a, b) < self._touching:
            return False
        width = self.problem.shape.pad_radius
        corners = palm_gap(_palms(a, width), _palms(b, width), width)
        return corners >= _CORNER_SHARE * self.problem.swing.body_clearance_m

    def _column(self, move: tuple[int, int]) -> Array:
        """Footprint of a gripper all along a swing."""
        if move not in self._columns:
            swing, shape = self.way(*move), self.problem.shape
            poses = swing.poses(max(3 * swing.intervals, 12))
            length = shape.half_length(float(poses[:, 4].max())) - shape.pad_radius
            self._columns[move] = self._footprints(poses, length)
        return self._columns[move]

    def _footprints(self, poses: Array, half_length: Array) -> Array:
        """Footprints (n, 1, 9, 3) of grippers; (n, 2, 9, 3), those of the palms too, where some are aslant."""
        seen = [footprint(poses, half_length)]
        if self.problem.hand_numbers == TILTED:
            seen.append(footprint(palms(poses, self.problem.shape.finger_height), half_length))
        return np.stack(seen, axis=1)


def _views(a: Array, b: Array) -> Iterator[Array]:
    """Turns (3, 3), from H, to axes along whose z grippers are looked at: along H's, and where some are aslant, along
    the ways off both holds, half way between these first.
    """
    yield np.eye(3)
    if a.shape[1] == 1:
        return
    first, second = ((each[:, 1] - each[:, 0]).mean(axis=(0, 1)) for each in (a, b))
    for way in (first + second, first, second):
        length, sine = float(np.linalg.norm(way)), float(np.hypot(way[0], way[1]))
        if min(sine, length) > _NO_WAY_M:
            yield gripper_rotation(0.0, np.arctan2(sine, way[2]) / sine * np.array([-way[1], way[0]]))


def _palms(footprints: Array, half_width: float) -> Array:
    """(n, 4) x, y, yaw and half length of the palms whose round ends lie around footprints (…, 9, 3)."""
    footprints = footprints.reshape(-1, *footprints.shape[-2:])
    way = footprints[:, -1, :2] - footprints[:, 0, :2]
    middle = (footprints[:, -1, :2] + footprints[:, 0, :2]) / 2
    length = np.linalg.norm(way, axis=1) / 2 + half_width
    return np.column_stack([middle, np.arctan2(way[:, 1], way[:, 0]), length])
