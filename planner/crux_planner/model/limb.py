"""Where the links of a limb are, and what they weigh, for a gripper upright on the wall.

The closed-form inverse kinematics written without angles: the elbow is a corner of a triangle, the wrist's axes are
cross products. Smooth wherever the limb is neither stretched nor folded, and the same for numbers, complex numbers,
arrays and casadi's expressions. Limbs without a closed form are in chain_limb.py.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.robot_bounds import JOINTS

from crux_planner.model.arrays import Array
from crux_planner.model.chain import chain_inverse
from crux_planner.model.chain_limb import chain_numbers, placed_chain
from crux_planner.model.placed_limb import PlacedLimb, Vector, combined, cross, dot, vector

NUMBERS = 36  # of a limb with a closed form
_STRETCHED = 0.999  # of a limb's links end to end


@dataclass(frozen=True)
class LimbMasses:
    """A limb, and what `placed` needs of it, (36,) SI units: place of the shoulder; lengths of upper link, lower link
    and wrist to gripper; cosine and sine of the gripper's turn on the last joint; then centre of mass and mass of
    links 1..6, each in its own frame, and of the hand (gripper and fingers) in the gripper frame. Of limbs without a
    closed form those of chain_limb.py.
    """

    limb: Limb
    numbers: Array

    def at(self, gripper: Vector, up: Vector, along: Vector, beyond: float = 0.0) -> Array:
        """What `placed` takes for these grippers: the numbers, and where there is no closed form also what it starts
        from, plus `beyond` where the limb does not reach.
        """
        if self.limb.closed_form:
            return self.numbers
        parts = np.array(np.broadcast_arrays(*gripper, *along, *cross(up, along), *up), dtype=float)
        place = np.moveaxis(parts[:3], 0, -1)
        rotation = np.moveaxis(parts[3:].reshape(3, 3, *parts.shape[1:]), (0, 1), (-1, -2))
        inverse = chain_inverse(self.limb)
        q, reached = inverse.inverse(place, rotation)
        seeds = inverse.seeds(q.reshape(-1, q.shape[-1]), reached.reshape(-1))
        seeds[~reached.reshape(-1)] += beyond
        own = np.broadcast_to(self.numbers, (len(seeds), len(self.numbers)))
        whole = np.concatenate([own, seeds], axis=1).T
        return np.asarray(whole.reshape(len(whole), *place.shape[:-1]))


def numbers_of_all(limbs: Sequence[LimbMasses], gripper: Vector, up: Vector, along: Vector) -> Array:
    """What `placed` takes for all limbs at once: grippers' components are (limbs, n), those of `up` (n,)."""
    if not limbs or limbs[0].limb.closed_form:
        return np.array([limb.numbers for limb in limbs]).reshape(-1, NUMBERS).T[..., None]
    each = [limb.at(_of(gripper, i), up, _of(along, i)) for i, limb in enumerate(limbs)]
    return np.stack(each, axis=1)


def _of(v: Vector, limb: int) -> Vector:
    return v[0][limb], v[1][limb], v[2][limb]


def limb_masses(robot: Robot, limb: Limb) -> LimbMasses:
    """The masses of a limb from the robot description."""
    if not limb.closed_form:
        return LimbMasses(limb, chain_numbers(robot, limb))
    turn = limb.gripper_mount_rad
    numbers = [*limb.shoulder_b_m, limb.upper_link_m, limb.lower_link_m, limb.wrist_to_gripper_m]
    numbers += [np.cos(turn), np.sin(turn)]
    for link in (robot.urdf.links[joint.child] for joint in limb.joints):
        numbers += [*link.com_m, link.mass_kg]
    return LimbMasses(limb, np.array([*numbers, *limb.hand_com_g_m, limb.hand_mass_kg]))


def in_reach(numbers: Any, gripper: Vector, up: Vector) -> Vector:
    """The gripper's centre, no farther than a stretched limb has it, as first guesses may; arguments as of `placed`.
    Limbs without a closed form start from where they reach.
    """
    if numbers.shape[0] > NUMBERS:
        return gripper
    away = combined((1.0, gripper), (numbers[5], up), (-1.0, vector(numbers, 0)))
    beyond = 1.0 - _STRETCHED * (numbers[3] + numbers[4]) / dot(away, away) ** 0.5
    return combined((1.0, gripper), (-(beyond + abs(beyond)) / 2, away))


def placed(numbers: Any, gripper: Vector, up: Vector, along: Vector) -> PlacedLimb:
    """The limb with its gripper's centre at `gripper`, z axis `up` and opening axis `along`, all in the body frame.

    `numbers` are those of LimbMasses.at along the first axis: of one limb, of several along further axes, or symbols.
    """
    if numbers.shape[0] > NUMBERS:
        return placed_chain(numbers, gripper, up, along)
    shoulder, upper, lower = vector(numbers, 0), numbers[3], numbers[4]
    wrist = combined((1.0, gripper), (numbers[5], up))
    elbow, out = _elbow(combined((1.0, wrist), (-1.0, shoulder)), upper, lower)
    side = (-out[1], out[0], 0.0)  # y of the yawed limb
    roll = cross(side, up)
    size = dot(roll, roll) ** 0.5
    roll = (roll[0] / size, roll[1] / size, roll[2] / size)
    across = cross(up, along)
    hand_x = combined((numbers[6], along), (-numbers[7], across))
    joint = combined((1.0, shoulder), (1.0, elbow))
    forearm = combined((1.0 / lower, wrist), (-1.0 / lower, joint))
    frames = [
        (shoulder, out, side),
        (shoulder, combined((1.0 / upper, elbow)), side),
        (joint, forearm, side),
        (wrist, roll, side),
        (wrist, roll, cross(up, roll)),
        (wrist, hand_x, cross(up, hand_x)),
        (gripper, along, across),
    ]
    depths = (*range(1, JOINTS + 1), JOINTS)
    places = [_at(*frame, vector(numbers, 8 + 4 * i)) for i, frame in enumerate(frames)]
    links = list(zip(depths, places, (numbers[11 + 4 * i] for i in range(len(frames))), strict=True))
    axes = [(0.0, 0.0, 1.0), combined((-1.0, side)), side, side, roll, up]
    return PlacedLimb([shoulder, shoulder, joint, wrist, wrist, wrist], axes, links)


def _at(origin: Vector, x: Vector, y: Vector, place: Vector) -> Vector:
    """A place in the frame with these axes."""
    return combined((1.0, origin), (place[0], x), (place[1], y), (place[2], cross(x, y)))


def _elbow(wrist: Vector, upper: float, lower: float) -> tuple[Vector, Vector]:
    """Elbow and the limb's horizontal direction for a wrist position, both positions from the shoulder."""
    radius = (wrist[0] ** 2 + wrist[1] ** 2) ** 0.5
    out = (wrist[0] / radius, wrist[1] / radius, 0.0)
    squared = radius**2 + wrist[2] ** 2
    share = (upper**2 - lower**2 + squared) / (2 * squared)  # foot of the elbow's height on the line to the wrist
    height = (upper**2 / squared - share**2) ** 0.5  # as a share of that line
    along = share * radius - height * wrist[2]
    return (along * out[0], along * out[1], share * wrist[2] + height * radius), out
