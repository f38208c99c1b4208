"""Certificates of lower bounds of J: the checker's own search, with multipliers that QPs of one knot propose.

What the QPs propose need not be trusted: the search proves what it can with them, and that is the bound written.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.certificates.bound.excursion import body_range, range_at
from crux_planner.certificates.bound.grasps import by_faces, grasps
from crux_planner.certificates.bound.multipliers import KnotQp, Multipliers
from crux_planner.certificates.bound.places import orientations
from crux_planner.checker.certificate import UNKNOWN, of_bound
from crux_planner.checker.cheapest_way import CheapestWay
from crux_planner.checker.geometry import rotation_about_z
from crux_planner.checker.no_way import AIR, Node, NotShownError
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.build import build_problem
from crux_planner.pipeline.certificates import rounded

QPS = 1200  # of a knot, at most: the work is counted, so that a certificate is the same every time
_ROUND = 40  # sets of grips asked about before the search is done again
_NEAR = 0.04  # above the bound: what multipliers are worked out for while they are looked for
_WINDOW = 8  # knots after the start and before the goal at which sets are asked about with the body where it can be


def certify_bound(scenario: Scenario, robot: Robot, steps: int, cost: float) -> dict[str, Any]:
    """A certificate that no plan of so many steps that `crux check` accepts costs less than its `bound`.

    It is at most `cost`, J of a plan as the checker counts it. Raises NotShownError (walks, starts in the air, others,
    walls with more sets of grips than the checker looks at) and OutsideError.
    """
    if scenario.contact.model != "patch" or scenario.start.air or scenario.not_upright or not robot.closed_form:
        raise NotShownError(UNKNOWN)
    way = CheapestWay(scenario, robot, steps)
    return of_bound(way, robot, _Asked(scenario, robot, way).shown(cost), cost)


class _Asked:
    """Asks for multipliers of the sets on the cheapest ways, until these have theirs."""

    def __init__(self, scenario: Scenario, robot: Robot, way: CheapestWay) -> None:
        problem = replace(build_problem(scenario, robot), steps=way.steps, friction_share=1.0)
        self._problem = replace(problem, boxes=problem.limb_reach.outer)
        self.way, self._to_w, self._left = way, rotation_about_z(np.array(problem.heading_rad)), QPS
        number = {(c.hold, "xy"[c.pair]): i for i, c in reversed(list(enumerate(problem.contacts)))}
        hold = {each.name: i for i, each in enumerate(scenario.holds)}
        self._contacts = [number.get((hold[name], faces)) for name, faces in (each.name for each in way.search.offers)]
        self._range = body_range(self._problem, np.inf)
        about = orientations(self._problem, -0.1, 0.1)
        first = [[own[0]] for own in by_faces(self._problem)]
        some = grasps(self._problem, about, *self._range, first)
        if some is None:
            raise NotShownError("no grasps")
        self._qp = KnotQp(Multipliers(self._problem, about, some))

    def shown(self, cost: float) -> list[tuple[int | None, list[Array]]]:
        """All that was shown, in order: the knot or None for all, and multipliers."""
        way, steps = self.way, self.way.steps
        outer = [k for k in range(steps) if min(k, steps - k) <= _WINDOW]
        asked: set[tuple[int | None, Node]] = set()
        shown: list[tuple[int | None, list[Array]]] = []

        def ask(knot: int | None, nodes: list[Node], which: Indices | None = None) -> None:
            new = [node for node in nodes if (knot, node) not in asked][: self._left]
            asked.update((knot, node) for node in new)
            found = [each for node in new if (each := self._multipliers(node, knot)) is not None]
            for each in found:
                way.show(knot, each, which)
            if found:
                shown.append((knot, found))

        ask(None, self._examples())
        while self._left > 0:
            through, before = way.drop(cost), len(asked)
            if not through.size:
                break
            on_way, limit = through <= through.min() + 1e-9, (1.0 + _NEAR) * through.min()
            nodes = [tuple(map(int, node)) for node in way.knots.sets]
            for knot in outer:
                near = np.flatnonzero(through[knot] <= limit)
                ask(knot, [nodes[i] for i in np.flatnonzero(on_way[knot])[:_ROUND]], near)
            inner = [k for k in range(steps) if k not in outer] or outer
            if not on_way[inner][:, [(None, node) not in asked for node in nodes]].any() and len(asked) == before:
                break
            least = through.min(axis=0)
            order = np.argsort(through[inner].min(axis=0), kind="stable")
            new = [nodes[i] for i in order if (None, nodes[i]) not in asked]
            ask(None, new[:_ROUND], np.flatnonzero(least <= limit))
        return shown

    def _examples(self) -> list[Node]:
        """The start's grips and some goal's, and each less one limb."""
        whole = [self.way.search.start(), min(self.way.search.goals())]
        return [(*node[:out], AIR, *node[out + 1 :]) for node in whole for out in range(5)][: 2 * 5]

    def _multipliers(self, node: Node, knot: int | None) -> Array | None:
        own = {limb: self._contacts[grip] for limb, grip in enumerate(node) if grip != AIR}
        held = {limb: contact for limb, contact in own.items() if contact is not None}
        if len(held) < len(own):
            return None
        self._left -= 1
        box = self._range if knot is None else range_at(self._problem, knot, self._range)
        found = -self._qp.multipliers(held, box)
        return rounded(np.concatenate([self._to_w @ found[:3], self._to_w @ found[3:]]))
