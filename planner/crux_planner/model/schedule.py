"""Which limb moves when: contacts of a sequence, and of every knot."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from crux_contracts import LIMB_NAMES

from crux_planner.model.arrays import Array

Stance = tuple[int, int, int, int]
"""The contact of every limb."""
Contacts = tuple[int | None, ...]
"""Of every limb, None in the air."""
SpeedLimits = Mapping[Contacts, float]
"""Largest body speed [m/s] while exactly these contacts are held."""


def stance_after(stance: Stance, limbs: tuple[int, ...], ends: tuple[int, ...]) -> Stance:
    """The stance in which limbs have gone to other contacts."""
    changed = list(stance)
    for limb, end in zip(limbs, ends, strict=True):
        changed[limb] = end
    return changed[0], changed[1], changed[2], changed[3]


@dataclass(frozen=True)
class Move:
    """From `before` to `after` the limbs `limbs` go to new contacts; the body lifts off and touches down in balance."""

    before: Stance
    after: Stance
    limbs: tuple[int, ...]
    lift_off: Array
    touch_down: Array

    @cached_property
    def support(self) -> tuple[int, ...]:
        """Contacts of the limbs that stay."""
        return tuple(c for limb, c in enumerate(self.before) if limb not in self.limbs)

    @property
    def held(self) -> Contacts:
        """Of every limb, None in the air."""
        return tuple(None if limb in self.limbs else c for limb, c in enumerate(self.before))


@dataclass(frozen=True)
class Swinging:
    """One swing at the knots: in the air at knots `first` .. `end` - 1."""

    limb: int
    first: int
    end: int
    start: int
    goal: int


@dataclass(frozen=True)
class Schedule:
    """Contacts and gripper poses at the knots 0..N.

    `contacts[k][limb]` is a contact's index, None in the air. `poses` (N + 1, 4, 5) holds x, y, z, yaw, opening (pad
    face to gripper centre); at the first knot in the air a gripper still stands in its old grasp.
    """

    moves: list[Move]
    contacts: list[list[int | None]]
    poses: Array

    @property
    def gait(self) -> list[str]:
        """The limbs in the order in which they release."""
        return ["+".join(LIMB_NAMES[limb] for limb in move.limbs) for move in self.moves]
