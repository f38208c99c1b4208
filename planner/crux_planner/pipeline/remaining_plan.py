"""What is left of a running plan from one of its stances on: contacts, swings, body, wrenches, read from its message.

It starts the exact P1 of a plan made again close to its solution, and tells the search which stances lead to the goal.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.hands import TILTED
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule, Stance
from crux_planner.physics.limit_surface import finger_inputs
from crux_planner.search.body_path import SPEED_SHARE
from crux_planner.trajectory.solution import Start

_SAME = 1e-6  # metres and radians between a grasp of the plan and one of the problem


@dataclass(frozen=True)
class RemainingPlan:
    """Knots 0..N from a stance on as a schedule, and where it starts the exact P1."""

    schedule: Schedule
    start: Start

    @property
    def steps(self) -> int:
        """Knot intervals N."""
        return len(self.schedule.contacts) - 1

    def open_to(self, problem: Problem) -> bool:
        """Whether all grasps on the way are still the problem's."""
        return len(self.known(problem)) > len(self.schedule.moves)

    def known(self, problem: Problem) -> dict[Stance, list[Move]]:
        """The moves that lead to the goal, from every stance on the way after which all grasps are the problem's."""
        usable, moves = [set(contacts) for contacts in problem.limb_contacts], self.schedule.moves
        found: dict[Stance, list[Move]] = {_stance(self.schedule.contacts[-1]): []}
        for i in range(len(moves) - 1, -1, -1):
            if not all(moves[i].after[limb] in usable[limb] for limb in moves[i].limbs):
                break
            found[moves[i].before] = moves[i:]
        return found

    def begun_at_rest(self, problem: Problem) -> RemainingPlan:
        """The same from the problem's start at rest, later by as much as the body needs to be where it lifts off."""
        contacts, body = self.schedule.contacts, self.start.body
        lift_off = next((k for k, knot in enumerate(contacts) if None in knot), self.steps - 1)
        pose, limits = np.concatenate([problem.start.position_m, problem.start.rpy_rad]), problem.body
        step = SPEED_SHARE * problem.dt_s * np.array([limits.max_speed_m_s] * 3 + [limits.max_rate_rad_s] * 3)
        way = body[lift_off, :6] - pose
        least = int(np.ceil(float((np.abs(way) / step).max()) - 1e-6))
        wait = max(lift_off, 1 + least)  # it rests in the first interval
        index = np.concatenate([np.zeros(wait - lift_off, dtype=int), np.arange(self.steps + 1)])
        moved = body[index]
        share = np.clip((np.arange(wait + 1) - 1) / (wait - 1), 0.0, 1.0) if wait > 1 else np.array([0.0, 1.0])
        moved[: wait + 1, :6] = pose + share[:, None] * way
        moved[:wait, 6:] = np.diff(moved[: wait + 1, :6], axis=0) / problem.dt_s
        schedule = Schedule(self.schedule.moves, [contacts[i] for i in index], self.schedule.poses[index])
        return RemainingPlan(schedule, Start(moved, [self.start.wrenches[i] for i in index[:-1]], near=True))


def read_remaining(problem: Problem, running: Any, first: int) -> RemainingPlan | None:
    """A running plan from knot `first` on, None where a grasp of it is none of the problem's.

    `problem` starts in that knot's stance, in the heading frame H of the plan's wall.
    """
    knots = running.knots[first:]
    to_h = rotation_z(-problem.heading_rad)
    poses = np.zeros((len(knots), 4, 7 if problem.hand_numbers == TILTED else 5))
    limbs = [limb for knot in knots for limb in knot.limbs]
    poses[..., :3] = _numbers(limbs, "gripper_position_w_m").reshape(-1, 4, 3) @ to_h.T
    poses[..., 3] = _numbers(limbs, "gripper_yaw_w_rad").reshape(-1, 4) - problem.heading_rad
    poses[..., 4] = _numbers(limbs, "finger_separation_m").reshape(-1, 4) / 2
    if problem.hand_numbers == TILTED:
        poses[..., 5:] = _numbers(limbs, "gripper_tilt_w_rad").reshape(-1, 4, 2) @ to_h[:2, :2].T
    contacts = _contacts(problem, running, knots, poses)
    if contacts is None:
        return None
    body = np.concatenate(
        [
            _numbers(knots, "body_position_w_m") @ to_h.T,
            _numbers(knots, "body_rpy_rad") - np.array([0.0, 0.0, problem.heading_rad]),
            _numbers(knots, "body_velocity_w_m_s") @ to_h.T,
            _numbers(knots, "body_angular_velocity_b_rad_s"),
        ],
        axis=1,
    )
    force = _numbers(limbs, "finger_force_w_n").reshape(-1, 4, 2, 3) @ to_h.T
    moment = _numbers(limbs, "finger_moment_w_nm").reshape(-1, 4, 2, 3) @ to_h.T
    wrenches = [
        {
            limb: _inputs(problem.contacts[c], force[k, limb], moment[k, limb])
            for limb, c in enumerate(now)
            if c is not None
        }
        for k, now in enumerate(contacts)
    ]
    schedule = Schedule(_moves(contacts, body), contacts, poses)
    return RemainingPlan(schedule, Start(body, wrenches[:-1], near=True))


def _inputs(contact: Contact, force_h: Array, moment_h: Array) -> Array:
    """q (5,) of the fingers' forces and moments (2, 3) on a contact."""
    leaning = (contact.normals, contact.touch_m) if contact.leans else None
    return finger_inputs(force_h, moment_h, contact.axis, contact.tangent, leaning, contact.up)


def _contacts(problem: Problem, running: Any, knots: list[Any], poses: Array) -> list[list[int | None]] | None:
    """Per knot and limb the problem's contact, None in the air."""
    holds = {name: i for i, name in enumerate(problem.hold_names)}
    found: dict[tuple[int, int, int], int | None] = {}
    contacts: list[list[int | None]] = []
    for k, knot in enumerate(knots):
        now: list[int | None] = []
        for limb, grasp in enumerate(knot.limbs):
            if grasp.hold < 0:
                now.append(None)
                continue
            key = (limb, int(grasp.hold), int(grasp.finger1_face))
            if key not in found:
                hold = holds.get(running.holds[grasp.hold].name)
                found[key] = _contact(problem, limb, hold, int(grasp.finger1_face), poses[k, limb])
            if found[key] is None:
                return None
            now.append(found[key])
        contacts.append(now)
    start = tuple(contacts[0])
    return contacts if start == problem.start_contacts else None


def _contact(problem: Problem, limb: int, hold: int | None, face: int, pose: Array) -> int | None:
    index: int
    for index in (problem.start_contacts[limb], *range(len(problem.contacts))):
        contact = problem.contacts[index]
        if (contact.hold, contact.finger1_face) == (hold, face) and np.abs(contact.pose - pose).max() < _SAME:
            return index
    return None


def _moves(contacts: list[list[int | None]], body: Array) -> list[Move]:
    """From one stance on all limbs to the next."""
    full = [k for k, now in enumerate(contacts) if None not in now]
    moves = []
    for left, reached in pairwise(full):
        before, after = _stance(contacts[left]), _stance(contacts[reached])
        limbs = tuple(limb for limb in range(4) if before[limb] != after[limb])
        if limbs:
            moves.append(Move(before, after, limbs, body[left + 1, :3], body[reached, :3]))
    return moves


def _stance(contacts: list[int | None]) -> Stance:
    a, b, c, d = (contact if contact is not None else -1 for contact in contacts)
    return a, b, c, d


def _numbers(messages: list[Any], name: str) -> Array:
    return np.array([getattr(message, name) for message in messages], dtype=float)
