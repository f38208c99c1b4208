"""Certificates are the checker's own searches, told where they ask which multipliers show what is wanted."""

from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.checker.certificate import of_no_plan
from crux_planner.checker.no_way import Node, NotShownError, NoWay
from crux_planner.checker.outer import OutsideError
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_z
from crux_planner.solvers import clock

TIME_LIMIT_S = 60.0  # of computing


def certify_no_plan(scenario: Scenario, robot: Robot, limit_s: float = TIME_LIMIT_S) -> dict[str, Any] | None:
    """A certificate that a climb has no plan; None where the checker's wider relaxation has a way, where there is not
    even a problem, of walks, starts in the air and other limbs, or when time is over.
    """
    if scenario.contact.model != "patch" or scenario.start.air or scenario.not_upright or not robot.closed_form:
        return None
    try:
        proof = Proof(scenario, robot, build_problem(scenario, robot))
        search = NoWay(scenario, robot)
        search.ask = _Asked(proof, search, clock.now() + limit_s)
        search.prove()
    except (InfeasibleError, NotShownError, OutsideError):
        return None
    return of_no_plan(search, robot)


class _Asked:
    """Answers from one problem's proof; places in balance are remembered."""

    def __init__(self, proof: Proof, search: NoWay, deadline: float) -> None:
        self._equilibrium, self._deadline = proof.equilibrium, deadline
        hold = {each.name: i for i, each in enumerate(search.scenario.holds)}
        names = (offer.name for offer in search.offers)
        self._grips = [proof.number.get((hold[name], "xy".index(faces))) for name, faces in names]
        self._to_w = rotation_z(proof.problem.heading_rad)
        self._known: dict[Node, list[Array]] = {}

    def __call__(self, node: Node, box: Array) -> Array | None:
        if clock.now() > self._deadline:
            raise NotShownError("no time was left")
        back, equilibrium = self._to_w.T, self._equilibrium
        middle, half = back @ box.mean(axis=0), np.abs(back) @ np.ptp(box, axis=0) / 2
        known, support = self._known.setdefault(node, []), tuple(g for i in node if (g := self._grips[i]) is not None)
        if len(support) < len(node) or any((np.abs(place - middle) <= half).all() for place in known):
            return None
        lacking, found = 0.0, np.zeros(6)
        place = equilibrium.centred.position(support, middle - half, middle + half, middle)
        if place is None:
            lacking, place, found = equilibrium.least_missing(support, middle - half, middle + half)
        if lacking <= 0.0:
            known.append(place)
            return None
        return rounded(np.concatenate([self._to_w @ found[:3], self._to_w @ found[3:]]))


def rounded(multipliers: Array) -> Array:
    """As the file has them."""
    return np.array([float(f"{x:.6g}") for x in multipliers])
