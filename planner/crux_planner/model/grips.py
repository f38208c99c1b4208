"""A grip as the proofs know it: a hold and a face pair, held anywhere on the faces."""

from __future__ import annotations

from dataclasses import dataclass

from crux_planner.model.contacts import Contact


@dataclass(frozen=True)
class Grip:
    """A hold and a face pair; the grasp may be `aside_m` to each side of the middle and anywhere in `height_m`."""

    contact: Contact
    aside_m: float
    height_m: tuple[float, float]
