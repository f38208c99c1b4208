"""Where on a wall the robot starts, and where to it climbs, by the planner's map of what limbs reach."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from crux_planner.method_report import StartStance

STARTS = 6  # that are tried, no two with the same grasps
LOW, HIGH = 0.25, 0.75  # shares of the heights at which a level body has four holds in reach: of starts, and goals


@dataclass(frozen=True)
class Way:
    """Where a way up from a stance ends: a stance to rest on, the moves to it, and by limb what stops it there."""

    goal: StartStance | None
    moves: int
    stops: dict[str, str]


@dataclass(frozen=True)
class Ends:
    """A start and a goal, or what there is none for."""

    start: StartStance | None = None
    goal: StartStance | None = None
    without: str = ""


def ends(found: list[StartStance], way_up: Callable[[StartStance], Way | str]) -> Ends:
    """A start in the lowest quarter of the wall, from where `way_up` leads into the highest quarter, else of those
    tried the one from where it leads the highest, if a limb moves at all. `way_up` says why a stance is no start.
    """
    if not found:
        return Ends(without="no level body has four holds in reach")
    heights = np.array([stance.body_m[0] for stance in found])
    lowest, span = float(heights.min()), float(np.ptp(heights))
    highest, ways = Ends(), list[Way | str]()
    for start in _starts([stance for stance in found if stance.body_m[0] <= lowest + LOW * span])[:STARTS]:
        way = way_up(start)
        ways.append(way)
        if isinstance(way, str) or way.goal is None or not way.moves:
            continue
        if highest.goal is None or way.goal.body_m[0] > highest.goal.body_m[0]:
            highest = Ends(start, way.goal)
        if way.goal.body_m[0] >= lowest + HIGH * span:
            break
    return highest if highest.goal is not None else Ends(without=_without(len(found), ways))


def _starts(found: list[StartStance]) -> list[StartStance]:
    """One of each set of grasps, in the middle of its places; those with the most places first."""
    alike: dict[object, list[StartStance]] = {}
    for stance in found:
        alike.setdefault((*stance.grasps.items(), *stance.grips.items()), []).append(stance)
    middles = []
    for each in sorted(alike.values(), key=len, reverse=True):
        places = np.array([stance.body_m for stance in each])
        off_m = np.linalg.norm(places - places.mean(axis=0), axis=1)
        middles.append(each[int(np.argmin(off_m))])
    return middles


def _without(places: int, ways: list[Way | str]) -> str:
    text = f"a level body has four holds in reach at {places} places, but"
    stuck = [way for way in ways if isinstance(way, Way)]
    if not stuck:
        return f"{text} none of the {len(ways)} tried can be a start; the first: {ways[0]}"
    stops = "; ".join(f"{limb} {why}" for limb, why in stuck[0].stops.items())
    return f"{text} no way up was found from the {len(ways)} tried; the first: {stops}"
