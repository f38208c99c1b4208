"""P1 of one scenario in numbers: everything the search and the NLP need, SI units, limbs LF, RF, LR, RR.

`h` in names is the heading frame H: W turned about its z so that the body starts with yaw 0 (see model/build.py).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from crux_contracts.gripper_frames import yaw_and_tilt
from crux_contracts.scenario import Uncertainty

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.contacts import Contact, GripperShape, SwingLimits
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.hands import TILTED, UPRIGHT
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.limb import LimbMasses
from crux_planner.model.schedule import Contacts, SpeedLimits, Stance
from crux_planner.model.surfaces import Surfaces
from crux_planner.model.workspace import LimbReach, Reach

BODY_STATES = 12  # r, theta, dr/dt, omega (body frame)
_GOAL_SHARE = 0.9  # of the goal's tolerance that a plan may use up
_AIM_SHARE = 0.3  # of it that a plan uses up where it can: the rest is left to what tracks it


@dataclass(frozen=True)
class Patch:
    """Contact data of (2) and (3)."""

    k_m: float  # of (2)
    max_normal_N: float
    spine_shear_N: float
    spine_twist_Nm: float


@dataclass(frozen=True)
class BodyBounds:
    """Bounds (7) of the body."""

    height_m: tuple[float, float]
    max_tilt_rad: float
    max_speed_m_s: float
    max_rate_rad_s: float
    lowest_m: float  # off the plane that level limbs hold

    @property
    def fastest_yaw_rad_s(self) -> float:
        """Fastest change of yaw within the bounds of body rates and tilt."""
        tilt = self.max_tilt_rad
        return float((np.sin(tilt) + 1.0) / np.cos(tilt) * self.max_rate_rad_s)


@dataclass(frozen=True)
class Weights:
    """Weights of J, equation (6), per knot: those of crux_contracts.cost_weights with the signs of (6)."""

    position: float
    orientation: float
    velocity: float
    wrench: float
    lift: float  # zeta, negative
    opening: float  # xi, negative
    switching: float


@dataclass(frozen=True)
class Pose:
    """Body pose in H."""

    position_m: Array
    rpy_rad: Array


@dataclass(frozen=True)
class Goal:
    """Where the climb ends; `grasps` maps a limb's index to (hold, pair)."""

    body: Pose
    tolerance_m: float
    tolerance_rad: float
    grasps: dict[int, tuple[int, int]]
    aim_share: float = _GOAL_SHARE  # of the tolerances, for the body's last pose

    @property
    def position_slack_m(self) -> float:
        """Half edge of the cube around the goal that lies well inside its tolerance."""
        return _GOAL_SHARE * self.tolerance_m / 3**0.5

    @property
    def rotation_slack_rad(self) -> float:
        """The same for roll, pitch and yaw."""
        return _GOAL_SHARE * self.tolerance_rad / 3**0.5

    @property
    def aim_m(self) -> float:
        """Half edge of the cube around the goal in which the body's last position is."""
        return self.aim_share * self.tolerance_m / 3**0.5

    @property
    def aim_rad(self) -> float:
        """The same for roll, pitch and yaw."""
        return self.aim_share * self.tolerance_rad / 3**0.5


@dataclass(frozen=True, kw_only=True)
class CentroidalProblem:
    """What P1 has whatever the limbs stand on: the body, its dynamics, its ends, its reach and the weights of J."""

    steps: int  # N
    dt_s: float
    gravity_h: Array
    mass_kg: float
    inertia_b: Array  # about the centre of mass, in the posture of the start
    limb_masses: tuple[LimbMasses, ...]
    body_moment_kg_m: Array  # (3,) mass times place of the body link's centre of mass, body frame
    start: Pose
    goal: Goal
    boxes: Reach  # (9a) of grippers or foot points
    body: BodyBounds
    weights: Weights
    heading_rad: float  # of H in W

    @cached_property
    def closed_form(self) -> bool:
        """Whether limbs have closed-form kinematics: proofs and bounds are about these alone."""
        return all(each.limb.closed_form for each in self.limb_masses)

    @property
    def chain_slots(self) -> int:
        """S of limbs without a closed form: their joints and still turns; 0 where they have one."""
        return 0 if self.closed_form else len(self.limb_masses[0].limb.at_zero.axes)


@dataclass(frozen=True, kw_only=True)
class Problem(CentroidalProblem):
    """P1 of a climb."""

    patch: Patch
    cuboids: Cuboids  # holds first, then obstacles
    surfaces: Surfaces
    hold_names: list[str]
    contacts: list[Contact]
    limb_contacts: list[list[int]]  # per limb, those that it may hold under some heading
    start_contacts: tuple[int, int, int, int]
    limb_reach: LimbReach  # `boxes` are its box or its inner set
    gripper_yaw_rad: tuple[float, float]  # relative to the body
    shape: GripperShape
    swing: SwingLimits
    friction_share: float  # of the limit surface that a plan may use
    limb_radii_m: tuple[float, ...]  # of model.shapes
    torque_limits_Nm: Array  # (4, S) peak torques, less the margin
    last_torques_Nm: Array  # (4, S) where that leaves no solution: peak torques, less the least margin
    limit_surface: str = "cone"  # of the exact NLP: cone, inner or paper (physics.limit_surface)
    follows: bool = False  # whether the body is to turn with bounded surfaces, as far as its limbs reach
    surface_reserve_N: float = 0.0  # kept of each finger's limit surface in the exact NLP
    speed_limits: SpeedLimits = field(default_factory=dict)  # where the body must be slower than its bound
    near: frozenset[Contacts] = frozenset()  # where limbs keep to their boxes
    nominal: Problem | None = None  # with the rows as they are without the scenario's uncertainty
    unsure_m: float = 0.0  # how far holds may be from where they are said to be
    unsure_rad: float = 0.0  # how far joints turn, about, to grip a hold that is elsewhere as far as it may be

    @cached_property
    def leans(self) -> bool:
        """Whether some grasp has a face that leans."""
        return any(contact.leans for contact in self.contacts)

    @cached_property
    def upright(self) -> bool:
        """Whether all faces and cuboids are, on one endless wall: proofs and bounds are about these alone."""
        return self.hand_numbers == UPRIGHT and self.cuboids.upright and not self.leans and not self.surfaces.names

    @cached_property
    def tall(self) -> Flags:
        """(V,) whether links and trunk may touch cuboids: those that stand higher than the lowest palm; any, where
        nothing keeps the body above palms.
        """
        if not self.surfaces.endless:
            return np.ones(len(self.cuboids.top_m), dtype=bool)
        lowest_m = min((contact.centre_h_m[2] for contact in self.contacts), default=0.0)
        return np.asarray(self.cuboids.top_m > self.shape.finger_height + lowest_m)

    @cached_property
    def solids(self) -> Cuboids:
        """What trunk and links keep off besides each other: tall cuboids, and what lies behind bounded surfaces."""
        return self.cuboids.some(self.tall).and_others(self.surfaces.slabs)

    @cached_property
    def may_follow(self) -> bool:
        """Whether grasps lean farther off a level body than limbs in `boxes` allow, along bounded surfaces alone."""
        leaning_rad = np.arccos(min(contact.up[2] for contact in self.contacts))
        return not self.surfaces.endless and bool(leaning_rad > self.boxes.max_tilt_rad)

    @cached_property
    def hand_numbers(self) -> int:
        """Of a hand, see model.hands."""
        return UPRIGHT if all(contact.tilt_rad is None for contact in self.contacts) else TILTED

    @property
    def weight_N(self) -> Array:
        """M g in H."""
        return self.mass_kg * self.gravity_h

    @property
    def gripper_height_m(self) -> tuple[float, float]:
        """Bounds of grippers that grip or swing, off the body's origin along W's z."""
        least, most = self.limb_reach.grip_height_m
        return least, max(most, self.swing.max_height_m - self.body.lowest_m)

    def may_move(self, stance: Stance) -> list[int]:
        """The limbs that may go on from a stance: those in the air first, while any is."""
        return [limb for limb, c in enumerate(stance) if not self.contacts[c].bears] or list(range(len(stance)))

    def may_end(self, limb: int, contact: Contact) -> bool:
        """Whether the goal lets a limb end on a contact: on any, where it names none."""
        return contact.bears and self.goal.grasps.get(limb) in (None, (contact.hold, contact.pair))

    def sure_of(self, known: Uncertainty) -> Problem:
        """The same with rows as much tighter as friction, mass and the places of holds are uncertain.

        Of each face the least friction is planned with, and told to the robot, whose own reserve of squeeze counts from
        there. What a mass that is elsewhere asks for depends on the plan: the check says it, and `surface_reserve_N`
        grows.
        """
        heavier, reach, off_m = 1.0 + known.mass_kg / self.mass_kg, self.limb_reach, known.hold_position_m
        reach = replace(reach, box=reach.box.less(off_m), inner=reach.inner.less(off_m))
        swing, aside_m = self.swing, 2**0.5 * off_m
        arm_m = min(mass.limb.lower_link_m for mass in self.limb_masses)
        clear_m = {name: getattr(swing, name) + aside_m for name in ("clearance_m", "body_clearance_m")}
        return replace(
            self,
            swing=replace(swing, **clear_m),
            boxes=reach.box,
            limb_reach=reach,
            contacts=[replace(c, friction=(1.0 - known.friction) * c.friction) for c in self.contacts],
            torque_limits_Nm=self.torque_limits_Nm / heavier,
            last_torques_Nm=self.last_torques_Nm / heavier,
            nominal=self,
            unsure_m=aside_m,
            unsure_rad=known.hold_yaw_rad + aside_m / arm_m,
        )

    def farther(self) -> Problem:
        """The same with all of the limbs' inner reach, where limbs keep to their boxes."""
        return replace(self, boxes=self.limb_reach.inner) if self.boxes is self.limb_reach.box else self

    def aimed(self) -> Problem:
        """The same with the body's last pose near the middle of the goal's tolerance."""
        return replace(self, goal=replace(self.goal, aim_share=_AIM_SHARE))


def turned_problem(problem: Problem, rpy_rad: Array) -> Problem:
    """The same problem with contacts and gravity in axes turned by roll, pitch and yaw (3,)."""
    if not rpy_rad.any():
        return problem
    to = rotation_from_rpy(rpy_rad).T
    turned = [yaw_and_tilt(to @ np.stack([c.axis, c.tangent, c.up], axis=1)) for c in problem.contacts]
    contacts = [
        replace(c, centre_h_m=to @ c.centre_h_m, yaw_rad=yaw, tilt_rad=tilt)
        for c, (yaw, tilt) in zip(problem.contacts, turned, strict=True)
    ]
    return replace(problem, gravity_h=to @ problem.gravity_h, contacts=contacts)
