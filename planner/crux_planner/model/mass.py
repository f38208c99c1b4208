"""Composite inertia and centre of mass of the whole robot from its description."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.urdf import Joint, Link

from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_from_rpy


def composite_inertia(robot: Robot, positions: dict[str, float]) -> Array:
    """(3, 3) about the body frame's origin, in its axes, at joint positions by name (rad or m)."""
    total = np.zeros((3, 3))
    for link, origin, rotation in _placed_links(robot, positions):
        total += _about_origin(link, origin, rotation)
    return total


def centre_of_mass(robot: Robot, positions: dict[str, float]) -> Array:
    """(3,) in the body frame, at joint positions by name (rad or m)."""
    moment = np.zeros(3)
    for link, origin, rotation in _placed_links(robot, positions):
        moment += link.mass_kg * (origin + rotation @ np.array(link.com_m))
    place: Array = moment / robot.total_mass_kg
    return place


def _placed_links(robot: Robot, positions: dict[str, float]) -> Iterator[tuple[Link, Array, Array]]:
    """Every link with its origin and rotation in the body frame."""
    children: dict[str, list[Joint]] = {}
    for joint in robot.urdf.joints.values():
        children.setdefault(joint.parent, []).append(joint)
    open_links = [(robot.body_link, np.zeros(3), np.eye(3))]
    while open_links:
        name, origin, rotation = open_links.pop()
        yield robot.urdf.links[name], origin, rotation
        for joint in children.get(name, []):
            open_links.append((joint.child, *_place(joint, positions.get(joint.name, 0.0), origin, rotation)))


def _place(joint: Joint, position: float, origin: Array, rotation: Array) -> tuple[Array, Array]:
    """Where a joint at `position` puts its child link."""
    at = origin + rotation @ np.array(joint.xyz_m)
    turned = rotation @ rotation_from_rpy(np.array(joint.rpy_rad))
    axis = np.array(joint.axis)
    if joint.kind == "prismatic":
        return at + turned @ axis * position, turned
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return at, turned @ (np.eye(3) + np.sin(position) * cross + (1.0 - np.cos(position)) * cross @ cross)


def _about_origin(link: Link, origin: Array, rotation: Array) -> Array:
    xx, xy, xz, yy, yz, zz = link.inertia_kg_m2
    own = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    com = origin + rotation @ np.array(link.com_m)
    inertia: Array = own + link.mass_kg * (com @ com * np.eye(3) - np.outer(com, com))
    return inertia
