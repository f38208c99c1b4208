"""When each move happens: the sequence scheduled over the N knots, and every gripper's pose at every knot."""

import numpy as np

from crux_planner.errors import HorizonError
from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Contacts, Move, Schedule, Swinging
from crux_planner.swing.at_knots import grippers_at_knots
from crux_planner.swing.swing_cache import SwingCache

TURN_SHARE = 0.9  # of the body's largest rate
SLOW_STEP_SHARE = 0.95  # of what a slower body could go, as usual
LONGEST_STANCE = 4  # knots between moves that spare time fills before it slows the swings


def least_durations(problem: Problem, swings: SwingCache, moves: list[Move], body_step_m: float) -> tuple[Array, Array]:
    """Least knots of the stance before each move, and after the last (n + 1,), and of each move (n,)."""
    stances, swing_knots = [], []
    body, margin = problem.start.position_m, 1  # the body rests in the first interval

    def step(held: Contacts) -> float:
        return min(body_step_m, SLOW_STEP_SHARE * problem.speed_limits.get(held, np.inf) * problem.dt_s)

    for move in moves:
        stances.append(max(1, margin + _knots(move.lift_off - body, step(move.before))))
        swing = max(swings.intervals(move.before[limb], move.after[limb]) for limb in move.limbs)
        swing_knots.append(max(swing, _knots(move.touch_down - move.lift_off, step(move.held))))
        body, margin = move.touch_down, 0
    last = step(moves[-1].after if moves else problem.start_contacts)
    stances.append(max(2, margin + 1 + _knots(problem.goal.body.position_m - body, last)))
    return np.array(stances), np.array(swing_knots, dtype=int)


def scheduled(problem: Problem, swings: SwingCache, moves: list[Move], body_step_m: float) -> Schedule:
    """The schedule of a sequence of moves. Raises InfeasibleError when the horizon is too short for it."""
    stances, swing_knots = least_durations(problem, swings, moves, body_step_m)
    spare = problem.steps - int(stances.sum() + swing_knots.sum())
    if spare < 0:
        needed = problem.steps - spare
        text = f"the climb needs {needed} steps of {problem.dt_s:g} s, the horizon has {problem.steps}"
        raise HorizonError(f"{text}; allow at least {needed}", needed)
    while spare > 0:
        shortest = int(np.argmin(stances))
        if stances[shortest] < LONGEST_STANCE or not len(swing_knots):
            stances[shortest] += 1
        elif swing_knots.min() < 2 * LONGEST_STANCE:
            swing_knots[int(np.argmin(swing_knots))] += 1
        else:
            stances[shortest] += 1
        spare -= 1
    return at_knots(problem, swings, moves, stances, swing_knots)


def at_knots(problem: Problem, swings: SwingCache, moves: list[Move], stances: Array, swing_knots: Array) -> Schedule:
    """The schedule with given knots of the stance before each move, and after the last (n + 1,), and each move (n,)."""
    airborne, k = list[Swinging](), 0
    for move, stance, knots in zip(moves, stances, swing_knots, strict=False):
        lift = k + int(stance)
        k = lift + int(knots)
        airborne += [Swinging(limb, lift, k, move.before[limb], move.after[limb]) for limb in move.limbs]
    return Schedule(moves, *grippers_at_knots(problem, swings, airborne))


def _knots(way: Array, step_m: float) -> int:
    return int(np.ceil(float(np.abs(way).max()) / step_m - 1e-6))
