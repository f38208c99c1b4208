"""That no plan leads from the start to the goal: all sets of grips that the robot may come to have lack one of them.

A node is a set of grips, one a limb or none (-1). From one knot to the next limbs release and take hold; one after the
other here, with nothing lost, since what is left in between bears the load alone. A limb that releases is still at its
hold at the first knot in the air, so that the body reaches its grip there while the others bear; when one takes hold,
the body is at most a step from where it was borne without. Every set that no multiplier shown refutes (`grips`) is
taken to bear, so that a search that ends without the other side proves that there is no way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.checker.geometry import Array, rotation_about_z
from crux_planner.checker.grips import Balance, Frame, Offer, offers
from crux_planner.checker.outer import FOLLOW, FORGIVEN_M, FORGIVEN_RAD, Outers

AIR = -1
_BIN_RAD, _WINDOW = 0.02, 10  # of headings; so many bins are asked for balance at once
_MOST = 200_000  # nodes and goals looked at
Node = tuple[int, ...]
Ask = Callable[[Node, Array], Array | None]
"""Multipliers (6,) that may refute sorted grips for a centre of mass in a box (2, 3), None: there are none."""


class NotShownError(Exception):
    """The multipliers do not show the claim; str() says how far they lead."""


@dataclass(frozen=True)
class Places:
    """Where the body's sole is, along each heading's axes, when a limb has a grip: (B, 4, G, 2) each."""

    yaw_rad: Array
    low: Array
    high: Array

    @staticmethod
    def of(wrists_m: Array, above_m: float, found: list[Offer], ends_rad: tuple[float, float]) -> Places:
        """From where wrists are off the body (4, 2, 3)."""
        count = max(1, int(np.ceil((ends_rad[1] - ends_rad[0]) / _BIN_RAD)))
        edges = np.linspace(*ends_rad, count + 1)
        yaw, half = (edges[1:] + edges[:-1]) / 2, (ends_rad[1] - ends_rad[0]) / count / 2
        corners = np.array([each.raised(above_m) for each in found]).reshape(-1, 4, 3)
        seen = np.einsum("gci,bij->bgcj", corners, rotation_about_z(yaw))[..., :2]  # Rz^T c
        far = np.abs(wrists_m).max(axis=1)[:, :2]
        more = half * far[:, ::-1] + half**2 / 2 * far + FORGIVEN_M
        low = seen.min(axis=2)[:, None] - (wrists_m[:, 1, :2] + more)[:, None]
        return Places(yaw, low, seen.max(axis=2)[:, None] - (wrists_m[:, 0, :2] - more)[:, None])

    def of_node(self, node: Node) -> tuple[Array, Array]:
        """(B, 2) each: where all its grips are in reach; nowhere where low is above high."""
        limbs = [limb for limb in range(4) if node[limb] != AIR]
        grips = [node[limb] for limb in limbs]
        return self.low[:, limbs, grips].max(axis=1), self.high[:, limbs, grips].min(axis=1)


class NoWay:
    """The search of one scenario, with the multipliers shown: {sorted grips: [(6,), ...]}."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        body, goal, horizon = robot.body, scenario.goal, scenario.horizon
        self.scenario, self.offers = scenario, offers(scenario, robot)
        self.hold = [each.name[0] for each in self.offers]
        self.shown: dict[Node, list[Array]] = {}
        self.ask: Ask | None = None
        tilt = body.max_tilt_rad + FORGIVEN_RAD
        slack = goal.tolerance_rad / np.cos(tilt + goal.tolerance_rad) + FORGIVEN_RAD
        last = goal.body.rpy_rad
        goal_tilt = min(tilt, max(abs(last[0]), abs(last[1])) + slack)
        self.outers = Outers(robot)
        self.outer, near = self.outers.within(tilt), self.outers.within(goal_tilt)
        fastest = self.fastest_rad_s = (1.0 + np.sin(tilt)) / np.cos(tilt) * (body.max_rate_rad_s + 1e-4)
        first = scenario.start.body.rpy_rad[2]
        turn = ((fastest * horizon.dt_s + FORGIVEN_RAD) * horizon.steps + slack) / 2 + FORGIVEN_RAD
        wide = max(turn, abs(last[2] - first) / 2)
        if 2 * turn + abs(last[2] - first) >= 2 * np.pi:
            raise NotShownError("the horizon is long enough to turn all the way round")
        middle = (first + last[2]) / 2
        self.headings_rad = middle - wide, middle + wide
        self.places = Places.of(self.outer.hold_m, self.outer.above_m, self.offers, self.headings_rad)
        self.at_goal = Places.of(near.hold_m, near.above_m, self.offers, (last[2] - slack, last[2] + slack))
        self.goal_box = np.array(goal.body.position_m) + np.outer([-1.0, 1.0], np.ones(3)) * (
            goal.tolerance_m + FORGIVEN_M
        )
        self.goal_sole_m = near.sole_m
        self.height_m = np.array([body.height_m[0] - FORGIVEN_M, body.height_m[1] + FORGIVEN_M])
        self.step_m = (body.max_speed_m_s + 1e-4) * horizon.dt_s * 2**0.5 + FORGIVEN_M
        self.balance = Balance(scenario, robot, self.outer, self.offers)
        self.starts = np.arange(0, len(self.places.yaw_rad), _WINDOW)  # of windows
        hop = fastest * horizon.dt_s
        bins = [self.places.yaw_rad[at : at + _WINDOW] for at in self.starts]
        self.frames = [Frame.of(self.outer, float(b.mean()), float(np.ptp(b)) / 2 + _BIN_RAD + hop) for b in bins]
        turned_goal = Frame.of(self.outer, last[2], slack + hop)
        self.frames.append(turned_goal)
        self._most: dict[tuple[Node, int], float] = {}
        self._grip: dict[tuple[int, bytes], float] = {}

    def prove(self) -> tuple[str, int]:
        """The side (`start`, `goal`) whose sets of grips have no way out, and their number; both go on by turns.

        Raises NotShownError.
        """
        ends = {"start": {self.start()}, "goal": self.goals()}
        seen, queues = {side: set(own) for side, own in ends.items()}, {side: deque(own) for side, own in ends.items()}
        if ends["start"] & ends["goal"]:
            raise NotShownError("the start's grips are the goal's")
        while True:
            side = min(queues, key=lambda each: len(queues[each]))
            if not queues[side]:
                return side, len(seen[side])
            for node in self._neighbours(queues[side].popleft(), side == "start"):
                if node in seen["goal" if side == "start" else "start"]:
                    raise NotShownError(f"nothing shown keeps the limbs from {self.text(node)}")
                if node not in seen[side]:
                    seen[side].add(node)
                    queues[side].append(node)
            if len(seen[side]) > _MOST:
                raise NotShownError(f"more than {_MOST} sets of grips")

    def text(self, node: Node) -> str:
        """For people."""
        return ", ".join(f"{name} on {self.hold[g]}" for name, g in zip(LIMB_NAMES, node, strict=True) if g != AIR)

    def _number(self, limb: str) -> int:
        grasp = self.scenario.start.grasps[limb]
        names = [each.name for each in self.offers]
        if (grasp.hold, grasp.faces) not in names:
            raise NotShownError(f"start.grasps: no gripper spans {grasp.hold} by {grasp.faces}")
        return names.index((grasp.hold, grasp.faces))

    def start(self) -> Node:
        """The grips that the robot begins with."""
        return tuple(self._number(limb) for limb in LIMB_NAMES)

    def goals(self) -> set[Node]:
        """Sets of four grips that the robot may end with."""
        where = self.at_goal
        sole = self._seen(self.goal_box, where.yaw_rad, self.goal_sole_m)
        found: list[tuple[Node, Array, Array]] = [((), *sole)]
        for limb, name in enumerate(LIMB_NAMES):
            wanted, more = self.scenario.goal.grasps.get(name), []
            usable = [
                g for g, each in enumerate(self.offers) if wanted is None or each.name == (wanted.hold, wanted.faces)
            ]
            for node, low, high in found:
                for g in usable:
                    both = np.maximum(low, where.low[:, limb, g]), np.minimum(high, where.high[:, limb, g])
                    if self.hold[g] not in {self.hold[i] for i in node} and (both[0] <= both[1]).all(axis=1).any():
                        more.append(((*node, g), *both))
            found = more
            if len(found) > _MOST:
                raise NotShownError(f"more than {_MOST} sets of grips at the goal")
        box = self.goal_box + np.outer([-1.0, 1.0], np.full(3, self.step_m))
        return {node for node, _, _ in found if not self._refuted(node, [(len(self.frames) - 1, box)])}

    @staticmethod
    def _seen(box: Array, yaw_rad: Array, more_m: float) -> tuple[Array, Array]:
        """Bounds (B, 2) along headings' axes of places in a box (2, 3), wider by so much."""
        turn = rotation_about_z(yaw_rad)[:, :2, :2]
        middle = np.einsum("bji,j->bi", turn, box.mean(axis=0)[:2])
        half = np.einsum("bji,j->bi", np.abs(turn), np.ptp(box, axis=0)[:2] / 2) + more_m + _BIN_RAD * np.ptp(box)
        return middle - half, middle + half

    def _neighbours(self, node: Node, forward: bool) -> list[Node]:
        found = []
        low, high = self.places.of_node(node)
        here = {self.hold[g] for g in node if g != AIR}
        for limb in range(4):
            if node[limb] != AIR:  # releases, or backwards: had just taken hold
                fewer = (*node[:limb], AIR, *node[limb + 1 :])
                if self._borne(fewer, low, high, 0.0 if forward else self.step_m):
                    found.append(fewer)
                continue
            lows = np.maximum(low[:, None], self.places.low[:, limb])
            highs = np.minimum(high[:, None], self.places.high[:, limb])
            for grip in map(int, np.flatnonzero((lows <= highs).all(axis=2).any(axis=0))):
                if self.hold[grip] in here:
                    continue
                if self._borne(node, lows[:, grip], highs[:, grip], self.step_m if forward else 0.0):
                    found.append((*node[:limb], grip, *node[limb + 1 :]))
        return found

    def _borne(self, node: Node, low: Array, high: Array, step_m: float) -> bool:
        """Whether a body within a step of soles in [low, high] may be borne by a node, at some heading."""
        if all(g == AIR for g in node):
            return False
        turn = rotation_about_z(self.places.yaw_rad)[:, :2, :2]
        middle, half = np.einsum("bij,bj->bi", turn, (low + high) / 2), (high - low) / 2 + self.outer.sole_m
        half = np.einsum("bij,bj->bi", np.abs(turn), half) + _BIN_RAD * self.outer.sole_m + step_m
        empty = np.asarray(low > high).any(axis=1, keepdims=True)
        lowest = np.minimum.reduceat(np.where(empty, np.inf, middle - half), self.starts)
        highest = np.maximum.reduceat(np.where(empty, -np.inf, middle + half), self.starts)
        heights = self.height_m + np.array([-step_m, step_m])
        boxes = [
            (w, np.column_stack([np.array([lowest[w], highest[w]]), heights]))
            for w in map(int, np.flatnonzero(np.isfinite(lowest[:, 0])))
        ]
        return not self._refuted(node, boxes)

    def _refuted(self, node: Node, boxes: list[tuple[int, Array]]) -> bool:
        """Whether some multipliers refute a node for every one of these bodies, each a frame and a box."""
        support = tuple(sorted(g for g in node if g != AIR))
        shown = self.shown.setdefault(support, [])
        for frame, box in boxes:
            if any(self._refutes(node, multipliers, box, frame) for multipliers in shown):
                continue
            more = None if self.ask is None else self.ask(support, self._centre(node, box, frame))
            if more is None or not self._refutes(node, more, box, frame):
                return False
            shown.append(more)
        return True

    def _centre(self, node: Node, box: Array, frame: int) -> Array:
        """Bounds (2, 3) of where the centre of mass may be."""
        held = tuple(limb for limb in range(4) if node[limb] != AIR)
        total = (1.0 - FOLLOW * len(held)) * box + self.frames[frame].rest(held)
        for limb in held:
            corners = FOLLOW * self.offers[node[limb]].raised(self.outer.above_m)
            total = total + np.array([corners.min(axis=0), corners.max(axis=0)])
        return np.asarray(total)

    def _refutes(self, node: Node, multipliers: Array, box: Array, frame: int) -> bool:
        held = tuple(limb for limb in range(4) if node[limb] != AIR)
        key, most = multipliers.tobytes(), 0.0
        for limb in held:
            at = node[limb], key
            if at not in self._grip:
                self._grip[at] = self.balance.most(self.offers[node[limb]], multipliers)
            most += self._grip[at]
        return self.balance.refuted(most, held, multipliers, box, self.frames[frame])
