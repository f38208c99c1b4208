"""What swings take and cost at least: knots in the air, changes of contact, and the weight on fewer limbs meanwhile."""

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem
from crux_planner.swing.swing import HEIGHT_RESERVE_M, STEP_SHARE


def shared_weight(problem: Problem) -> Array:
    """Least R |u|^2 (4,) of a knot with 0..3 limbs in the air: fingers that share the weight evenly."""
    slack = 3**0.5 * problem.mass_kg * 2 * problem.body.max_speed_m_s / problem.dt_s
    force = max(float(np.linalg.norm(problem.weight_N)) - slack, 0.0)
    return np.asarray(problem.weights.wrench * force**2 / (2 * (4 - np.arange(4))))


def earned(problem: Problem) -> float:
    """Least cost (mostly negative) of height and opening of a limb in the air, a knot."""
    weights = problem.weights
    lift, opening = weights.lift * problem.swing.max_height_m, 2 * weights.opening * problem.shape.largest_opening
    return min(lift, 0.0) + min(opening, 0.0)


def knots_in_air(problem: Problem, contacts: Indices, *, back: bool = False) -> Array:
    """(C, C) of the quickest swings between contacts: up, across, down as in swing.swing; inf on the diagonal, but for
    swings that lead `back` to where they began.
    """
    limits = problem.swing
    reach, turn = STEP_SHARE * limits.speed_m_s * limits.dt_s, STEP_SHARE * limits.yaw_rate_rad_s * limits.dt_s
    own = [problem.contacts[c] for c in contacts]
    place, yaw = np.array([c.centre_h_m for c in own]), np.array([c.yaw_rad for c in own])
    top = problem.cuboids.top_m[[c.hold for c in own]]
    height = np.maximum(top[:, None], top) + limits.clearance_m + HEIGHT_RESERVE_M
    ups = np.maximum(np.ceil((height - place[:, None, 2]) / reach - 1e-9), 1.0)
    downs = np.maximum(np.ceil((height - place[None, :, 2]) / reach - 1e-9), 1.0)
    across = np.linalg.norm(place[:, None, :2] - place[None, :, :2], axis=2) / reach
    turned = np.abs(yaw[:, None] - yaw) % np.pi
    turned = np.minimum(turned, np.pi - turned) / turn  # fingers may be swapped
    air: Array = ups + downs + np.maximum(np.ceil(np.maximum(across, turned) - 1e-9), 1.0)
    if not back:
        np.fill_diagonal(air, np.inf)
    return air


def quickest_to(problem: Problem, groups: list[Indices]) -> Indices:
    """Knots in the air (G,) of the quickest swing to each group of contacts, from wherever."""
    least = knots_in_air(problem, np.concatenate(groups)).min(axis=0, initial=np.inf)
    least = np.minimum.reduceat(least, np.cumsum([0, *(len(group) for group in groups[:-1])]))
    return np.where(np.isfinite(least), least, 2.0).astype(int)


def airborne(problem: Problem, contacts: Indices) -> tuple[Array, Array]:
    """Bounds (3,), (3,) in H of a gripper in the air between contacts: on the line, or round what is too tall."""
    own = [problem.contacts[c].centre_h_m for c in contacts]
    low, high = np.min(own, axis=0), np.max(own, axis=0)
    high[2] = max(high[2], problem.swing.max_height_m)
    first, last = _around_tall(problem)
    if len(first):
        low[:2], high[:2] = np.minimum(low[:2], first.min(axis=0)), np.maximum(high[:2], last.max(axis=0))
    return low, high


def swing_ranges(problem: Problem, contacts: Indices, begins: Indices, lands: Indices) -> tuple[Array, Array]:
    """Bounds (P, 3), (P, 3) in H of a gripper on swings between `contacts`, by their places there: the line between
    both ends, and round what is too tall wherever that comes near what it has to go round already.
    """
    place = np.stack([problem.contacts[c].centre_h_m for c in contacts])
    low, high = np.minimum(place[begins], place[lands]), np.maximum(place[begins], place[lands])
    high[:, 2] = np.maximum(high[:, 2], problem.swing.max_height_m)
    first, last = _around_tall(problem)
    for _ in range(len(first)):
        for start, end in zip(first, last, strict=True):
            near = ((low[:, :2] <= end) & (start <= high[:, :2])).all(axis=1)
            low[near, :2], high[near, :2] = np.minimum(low[near, :2], start), np.maximum(high[near, :2], end)
    return low, high


def _around_tall(problem: Problem) -> tuple[Array, Array]:
    """Bounds (n, 2), (n, 2) of where grippers go round what they cannot go over."""
    cuboids, limits, shape = problem.cuboids, problem.swing, problem.shape
    tall = np.flatnonzero(cuboids.top_m + limits.clearance_m + HEIGHT_RESERVE_M > limits.max_height_m)
    wide = np.linalg.norm(cuboids.half_m[tall, :2], axis=1)[:, None]
    wide = wide + 2**0.5 * (limits.clearance_m + shape.half_length(shape.largest_opening) + shape.pad_radius)
    foot = cuboids.foot_h_m[tall, :2]
    return foot - wide, foot + wide


def ends(problem: Problem, limb: int, contacts: Indices) -> Indices:
    """Which of the contacts a limb may end on."""
    return np.flatnonzero([problem.may_end(limb, problem.contacts[c]) for c in contacts])


def knot_floor(problem: Problem) -> tuple[float, float]:
    """Least R |u|^2 of a knot and what limbs in the air earn: whatever they do, and what each of those adds."""
    air = np.arange(4)
    by_air = shared_weight(problem) + earned(problem) * air
    more = float(by_air[1] - by_air[0])  # the next ones add no less
    return (float(by_air[0]), more) if more > 0.0 else (float(by_air.min()), 0.0)


def detours(problem: Problem, limb: int, contacts: Indices) -> Array:
    """Least cost (C,) of a limb's swings that lead from its start, first of `contacts`, over each to its end."""
    _, knot = knot_floor(problem)
    chain = 2 * problem.weights.switching + knot * knots_in_air(problem, contacts)
    np.fill_diagonal(chain, 0.0)
    for via in range(len(contacts)):
        chain = np.minimum(chain, chain[:, via, None] + chain[via])
    last = ends(problem, limb, contacts)
    rest = chain[:, last].min(axis=1) if len(last) else np.zeros(len(contacts))
    return np.asarray(chain[0] + rest)


def distinct(problem: Problem, limb: int) -> Indices:
    """The contacts of a limb, one a place on a face pair, the start's first: the swap of fingers changes nothing."""
    kept: dict[tuple[int, int, int, bytes], int] = {}
    for c in [problem.start_contacts[limb], *problem.limb_contacts[limb]]:
        contact = problem.contacts[c]
        hanging = contact.finger1_face if contact.spines_only else -1  # a finger that does not press hangs on a face
        kept.setdefault((contact.hold, contact.pair, hanging, contact.centre_h_m.tobytes()), c)
    return np.array(list(kept.values()))


def floor(problem: Problem) -> float:
    """A rough bound of all but the body's pose: the weight shared evenly, each limb's cheapest swings to its end."""
    least = sum(float(detours(problem, limb, distinct(problem, limb)).min()) for limb in range(4))
    return problem.steps * knot_floor(problem)[0] + least
