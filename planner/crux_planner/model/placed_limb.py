"""A limb's links where they are. A vector is a tuple of three numbers, arrays or expressions of casadi, all alike."""

from dataclasses import dataclass
from typing import Any

Vector = tuple[Any, Any, Any]


@dataclass(frozen=True)
class PlacedLimb:
    """Joints' origins and axes, and of every link how many joints are before it, its centre of mass and its mass [kg];
    the hand (gripper and fingers) comes last. In the frame of the gripper that was given.
    """

    origins: list[Vector]
    axes: list[Vector]
    links: list[tuple[int, Vector, Any]]

    def first_moment(self) -> Vector:
        """Sum of mass times place [kg m]."""
        total: Vector = (0.0, 0.0, 0.0)
        for _, place, mass in self.links:
            total = combined((1.0, total), (mass, place))
        return total


def combined(*parts: tuple[Any, Vector]) -> Vector:
    """Sum of numbers times vectors."""
    x, y, z = (sum(number * vector[i] for number, vector in parts) for i in range(3))
    return x, y, z


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> Any:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def vector(numbers: Any, first: int) -> Vector:
    """Three numbers in a row."""
    return numbers[first], numbers[first + 1], numbers[first + 2]
