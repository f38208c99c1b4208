"""Where the centre of mass c can be about the body and its grippers: c = r + k sum (p - r) + e, bounds of e.

Of a limb only the elbow is no straight line in the places of shoulder and wrist. For a wrist at v off the shoulder it
is l1 (cos, sin)(elevation of v + angle at the shoulder) outwards and up. So e is the sum over limbs of
N(v) = kappa elbow(v) - beta v, outwards and up, by how far out and how high the wrist is; and of what the body's own
mass and masses beside the links' lines add. N is enclosed by intervals over cells of (how far out, how high). A tilt
turns the limb's plane: for tilts up to the end of each cell of bound.places the ends are wider by what that can do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from crux_contracts.compiled import doubles, integers

from crux_planner.certificates.bound import native
from crux_planner.certificates.bound.grasps import Grasps, Groups
from crux_planner.certificates.bound.places import Orientations, shoulder_to_wrist, shoulders
from crux_planner.certificates.bound.swings import airborne
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.limb import LimbMasses
from crux_planner.model.mass import yawed_bounds
from crux_planner.model.problem import Problem

FOLLOW = 0.098  # k: any number is true, this one leaves little open
_CELL_M = 0.005
_ROUNDING_M = 1e-6
_ENDS = 5  # least and most outwards, least and most up, and how far outwards is turned by a tilt at most


@dataclass(frozen=True)
class _Limb:
    """Lengths [m], and masses [kg] and masses times places [kg m] of one limb, less k M times its gripper's place."""

    shoulder_b_m: Array
    upper_m: float
    lower_m: float
    shortest_m: float  # from shoulder to wrist, up to the joint limits
    longest_m: float
    wrist_m: float  # above the gripper
    elbow: float  # kappa
    wrist: float  # beta
    shoulder: float
    up: float  # constant along W's z
    body_up: float  # the same along the body's
    beside: float  # of links whose centre of mass is not on the line of their joints

    @staticmethod
    def of(limb: LimbMasses, follow_kg: float) -> _Limb:
        n = limb.numbers
        upper, lower, above = (float(number) for number in n[3:6])
        links = n[8:].reshape(-1, 4)
        place, mass = links[:, :3], links[:, 3]
        near, far = mass[1] + mass[2], mass[2] * place[2, 0] / lower
        wrist = follow_kg - far - mass[3:].sum()
        off = np.hypot(place[[0, 5, 6], 0], place[[0, 5, 6], 1]) @ mass[[0, 5, 6]]
        off += np.hypot(place[1:3, 1], place[1:3, 2]) @ mass[1:3] + np.linalg.norm(place[3:5], axis=1) @ mass[3:5]
        elbow = mass[1] * place[1, 0] / upper + mass[2] - far
        up = (follow_kg - mass[6]) * above + mass[5:] @ place[5:, 2]
        shoulder = mass[0] + near - far - wrist
        lengths = upper, lower, *shoulder_to_wrist(limb.limb), above
        masses = elbow, wrist, shoulder, up, mass[0] * place[0, 2], off
        return _Limb(n[:3], *lengths, *(float(number) for number in masses))

    def ends(self, low_m: float, high_m: float, tilt: float) -> Array:
        """(_ENDS, cells) of N by how far out the wrist is, at heights in [low, high] along the body's z, which is
        turned by up to `tilt`; least above most where the limb does not reach.
        """
        far = np.arange(0.0, self.longest_m + _CELL_M, _CELL_M)
        high = np.append(np.arange(low_m, high_m, _CELL_M), high_m)
        r0, r1, z0, z1 = far[:-1, None], far[1:, None], high[:-1], high[1:]
        near = np.hypot(r0, np.maximum(np.maximum(z0, -z1), 0.0))
        away = np.hypot(r1, np.maximum(np.abs(z0), np.abs(z1)))
        outside = np.where((near <= self.longest_m) & (away >= self.shortest_m), 0.0, np.inf)
        reached = abs(self.upper_m - self.lower_m), self.upper_m + self.lower_m
        d0, d1 = np.clip(near, *reached), np.clip(away, *reached)
        difference = self.upper_m**2 - self.lower_m**2
        flat = np.clip(max(difference, 0.0) ** 0.5, d0, d1)  # where the angle at the shoulder is largest
        with np.errstate(divide="ignore", invalid="ignore"):
            cosines = [np.nan_to_num((difference / d + d) / (2 * self.upper_m), nan=-1.0) for d in (d0, d1, flat)]
        narrow, wide = (np.arccos(np.clip(pick(cosines, axis=0), -1.0, 1.0)) for pick in (np.max, np.min))
        least = np.arctan2(z0, np.where(z0 < 0.0, r0, r1)) + narrow
        most = np.arctan2(z1, np.where(z1 < 0.0, r1, r0)) + wide
        size = self.elbow * self.upper_m
        out, up = (_scaled(size, _cosines(least - turn, most - turn)) for turn in (0.0, np.pi / 2))
        out, up = (_plus(a, _scaled(-self.wrist, b)) for a, b in ((out, (r0, r1)), (up, (z0, z1))))
        outwards, upwards = (np.maximum(np.abs(a), np.abs(b)) for a, b in (out, up))
        sine, turned = np.sin(tilt), np.minimum(2 * np.sin(tilt) * away / np.maximum(r0, 1e-9), 2.0)
        rise = sine * outwards + (1.0 - np.cos(tilt)) * upwards
        ends = [out[0] + outside, -out[1] + outside, up[0] - rise + outside, -up[1] - rise + outside, outside - turned]
        found = np.array([end.min(axis=1) for end in ends])
        found[[1, 3, 4]] *= -1.0
        return found


def _cosines(low: Array, high: Array) -> tuple[Array, Array]:
    """Range of the cosine over intervals [low, high] that lie within [-2 pi, 2 pi]."""
    a, b = np.cos(low), np.cos(high)
    least, most = np.minimum(a, b), np.where((low <= 0.0) & (high >= 0.0), 1.0, np.maximum(a, b))
    for half_turn in (-np.pi, np.pi):
        least = np.where((low <= half_turn) & (high >= half_turn), -1.0, least)
    return least, most


def _scaled(factor: float, ends: tuple[Array, Array]) -> tuple[Array, Array]:
    low, high = factor * ends[0], factor * ends[1]
    return (low, high) if factor >= 0.0 else (high, low)


def _plus(a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    return a[0] + b[0], a[1] + b[1]


class CentreOfMass:
    """Bounds of e for pairs of grasps and cells of yaw, by cells of tilt."""

    def __init__(self, problem: Problem, about: Orientations) -> None:
        self._about, self._mass_kg = about, problem.mass_kg
        self._contacts = np.stack([contact.centre_h_m for contact in problem.contacts])
        self._problem = problem
        self._known_spans: dict[int, tuple[list[Indices], Array, Array]] = {}  # by the list itself, which is kept
        self._limbs = [_Limb.of(limb, FOLLOW * problem.mass_kg) for limb in problem.limb_masses]
        heights, tilt = problem.body.height_m, problem.body.max_tilt_rad
        tilts = [float(np.arccos(np.cos(tilt * (t + 1) / len(about.shift_m)) ** 2)) for t in range(len(about.shift_m))]
        self._shoulders = [shoulders(problem, about, limb) for limb in range(4)]
        self._tables: list[list[Array]] = []
        self._heights: list[list[Array]] = []
        gripped = self._contacts[:, 2].min(), self._contacts[:, 2].max()
        swinging = gripped[0], max(gripped[1], problem.swing.max_height_m)
        for limb in self._limbs:
            sets = []
            for low, high in (gripped, swinging):
                level = [low - heights[1], high - heights[0]]
                level = [end + limb.wrist_m - limb.shoulder_b_m[2] for end in level]
                sets.append(self._of_limb(limb, level, tilts))
            self._tables.append([tables for tables, _ in sets])
            self._heights.append([heights for _, heights in sets])
        most_up = max(float(np.abs(tables[:, 0, -1, 2:4]).max()) for sets in self._tables for tables in sets)
        self._turns = np.cos(tilts), np.sin(tilts)
        self._aside = self._turns[1] * most_up
        own = problem.body_moment_kg_m + sum(limb.shoulder * limb.shoulder_b_m for limb in self._limbs)
        own[2] += sum(limb.body_up for limb in self._limbs)
        yaw = max(-float(about.yaw_low[0]), float(about.yaw_high[-1]))
        leans = 2 * np.sin(np.array(tilts) / 2) * np.linalg.norm(own)
        up, beside = sum(limb.up for limb in self._limbs), sum(limb.beside for limb in self._limbs)
        both = [yawed_bounds(own - lean - beside, own + lean + beside, yaw) for lean in leans]
        self._own = np.array(both) + np.array([0.0, 0.0, up])  # (T, 2, 3)
        self.anywhere = self._anywhere()  # (T, 2, 3) of any grasps

    @staticmethod
    def _of_limb(limb: _Limb, level: list[float], tilts: list[float]) -> tuple[Array, Array]:
        """(T, cells, cells, _ENDS) from the first to the last cell of how far out, and (T,) how far the wrist is
        at most from the shoulder along W's z.
        """
        most, length = max(abs(level[0]), abs(level[1])), limb.longest_m + float(np.linalg.norm(limb.shoulder_b_m))
        tables, heights = [], []
        for tilt in tilts:
            more = np.sin(tilt) * length + (1.0 - np.cos(tilt)) * (most + length)
            by_cell = limb.ends(level[0] - more, level[1] + more, tilt)
            many = by_cell.shape[1]
            table = np.tile(np.array([np.inf, -np.inf, np.inf, -np.inf, 0.0])[:, None, None], (1, many, many))
            for first in range(many):
                table[::2, first, first:] = np.minimum.accumulate(by_cell[::2, first:], axis=1)
                table[1::2, first, first:] = np.maximum.accumulate(by_cell[1::2, first:], axis=1)
                table[4, first, first:] = np.maximum.accumulate(by_cell[4, first:])
            tables.append(np.moveaxis(table, 0, -1))
            heights.append(2 * np.sin(tilt / 2) * float(np.linalg.norm(limb.shoulder_b_m)) + most)
        return np.ascontiguousarray(tables), np.array(heights)

    def _anywhere(self) -> Array:
        """(T, 2, 3) of any grasps."""
        total = self._own.copy()
        for tables in self._tables:
            ends = np.stack([each[:, 0, -1] for each in tables])  # (2, T, _ENDS)
            side = np.abs(ends[..., :2]).max(axis=(0, 2)) + self._aside
            total[:, 0] += np.column_stack([-side, -side, ends[..., 2].min(axis=0)])
            total[:, 1] += np.column_stack([side, side, ends[..., 3].max(axis=0)])
        return np.asarray(total / self._mass_kg)

    def asked(self, nodes: Grasps) -> Grasps:
        """The nodes, told apart in `rest` from now on."""
        shape = len(nodes.node), *self.anywhere.shape
        return replace(nodes, rest=np.empty(shape, dtype=np.float32), known=np.zeros(shape[0], dtype=bool))

    def rest(self, nodes: Grasps, pairs: Indices) -> Array:
        """(len(pairs), T, 2, 3) of pairs, that of any grasps where nodes are not told apart: one for all."""
        if nodes.rest is None or nodes.known is None:
            return self.anywhere[None]
        new = pairs[~nodes.known[pairs]]
        if len(new):
            nodes.rest[new] = self.of(nodes, new) + np.array([[-_ROUNDING_M], [_ROUNDING_M]])
            nodes.known[new] = True
        return nodes.rest[pairs]

    def within(self, nodes: Grasps, pairs: Indices, box: tuple[Array, Array]) -> Array:
        """(len(pairs), T, 2, 3) of pairs with the body within a box, too."""
        shift = self._about.shift_m[-1] * np.array([1.0, 1.0, 0.0])
        low, high = np.maximum(nodes.low[pairs], box[0] - shift), np.minimum(nodes.high[pairs], box[1] + shift)
        near = replace(nodes, low=low, high=np.maximum(low, high), node=nodes.node[pairs], cell=nodes.cell[pairs])
        found = self.of(near, np.arange(len(pairs))) + np.array([[-_ROUNDING_M], [_ROUNDING_M]])
        known = (found[:, :, 0] <= found[:, :, 1]).all(axis=2)[..., None, None]
        return np.asarray(np.where(known, found, self.anywhere))

    def of(self, nodes: Grasps, pairs: Indices) -> Array:
        """(len(pairs), T, 2, 3); least above most where no limb reaches so."""
        low, high = nodes.low[pairs], nodes.high[pairs]
        node, cell = nodes.node[pairs], nodes.cell[pairs]
        options, bounds = np.ascontiguousarray(nodes.options), np.empty((len(node), *self._own.shape))
        given = doubles(low), doubles(high), integers(node), integers(cell), integers(options), doubles(bounds)
        native.needed().crux_mass_bounds(self._masses(nodes.groups), len(node), *given)
        return bounds

    def _masses(self, groups: Groups) -> native.Masses:
        """For limbs that have these options."""
        limbs = []
        for limb, own in enumerate(groups):
            sets = (
                native.MassTable(each.shape[1], doubles(each), doubles(height))
                for each, height in zip(self._tables[limb], self._heights[limb], strict=True)
            )
            places = map(doubles, (*self._shoulders[limb], *self._spans(own)))
            limbs.append(native.MassLimb((native.MassTable * 2)(*sets), len(own) + 1, *places))
        tilts = map(doubles, (self._own, *self._turns, self._aside))
        rest = _CELL_M, self._about.shift_m[-1], self._mass_kg
        return native.Masses((native.MassLimb * 4)(*limbs), len(self._own), *tilts, *rest)

    def _spans(self, groups: list[Indices]) -> tuple[Array, Array]:
        """(n + 1, 3) least and most of the places of the gripper on each group of contacts, and in the air."""
        if id(groups) not in self._known_spans:
            air = airborne(self._problem, np.concatenate(groups))
            first = np.array([*(self._contacts[group].min(axis=0) for group in groups), air[0]])
            last = np.array([*(self._contacts[group].max(axis=0) for group in groups), air[1]])
            self._known_spans[id(groups)] = groups, first, last
        return self._known_spans[id(groups)][1:]
