"""A scenario as typed values. Frame W: z off the wall, x up the slope."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from typing import Literal

from .yaml_document import DocumentError

Faces = Literal["x", "y"]
FACE_NAMES = ("+x", "-x", "+y", "-y", "top")
METHODS = ("auto", "two_block", "multi_block", "benchmark")
LIMIT_SURFACES = ("cone", "inner", "paper")
IDLE = ("cut", "keep")  # knots of a plan at which nothing moves
WEIGHTS = ("body", "position", "orientation", "velocity", "wrench", "lift", "opening", "switching")
MARGINS = ("friction", "clearance_m", "torque")
GRAVITY_M_S2 = 9.81
TWIST_RADIUS_RATIO = 2.0 / 3.0
"""k / r_p of equation (2): exact for pure twist of a round patch under uniform pressure."""


class ScenarioError(DocumentError):
    """A scenario file that cannot be used; str() names file, line, key, value and what would be right."""


@dataclass(frozen=True)
class Wall:
    slope_deg: float
    friction: float = 0.6

    @property
    def slope_rad(self) -> float:
        return math.radians(self.slope_deg)

    @property
    def gravity_w_m_s2(self) -> tuple[float, float, float]:
        """g in the wall's frame: 0 is the floor, 90 a vertical wall."""
        return (-GRAVITY_M_S2 * math.sin(self.slope_rad), 0.0, -GRAVITY_M_S2 * math.cos(self.slope_rad))


@dataclass(frozen=True)
class Contact:
    """Patch: limit surface (2) with spines (3), a finger. Point: Coulomb friction of a foot on the wall.

    `spines_only` names, by limb, the finger (1 or 2) whose normal force is 0 all the time: its spines alone carry it.
    """

    model: Literal["patch", "point"]
    patch_radius_m: float = 0.02
    max_normal_N: float = 60.0
    spine_shear_N: float = 0.0
    spine_twist_Nm: float = 0.0
    spines_only: dict[str, int] = field(default_factory=dict)

    @property
    def patch_k_m(self) -> float:
        """k of equation (2)."""
        return TWIST_RADIUS_RATIO * self.patch_radius_m


@dataclass(frozen=True)
class Cuboid:
    """Stands on the wall at position_m (centre of its foot), turned by yaw about W's z."""

    name: str
    position_m: tuple[float, float]
    size_m: tuple[float, float, float]
    yaw_deg: float = 0.0

    @property
    def yaw_rad(self) -> float:
        return math.radians(self.yaw_deg)


@dataclass(frozen=True)
class Hold(Cuboid):
    """A graspable cuboid. friction and spines follow FACE_NAMES."""

    friction: tuple[float, ...] = ()
    spines: tuple[bool, ...] = (True,) * len(FACE_NAMES)


@dataclass(frozen=True)
class Obstacle(Cuboid):
    """A cuboid to be kept clear of."""


@dataclass(frozen=True)
class Grasp:
    """faces x: fingers on +x and -x of the hold; y: on +y and -y. `finger1` is the face under finger 1, where given."""

    hold: str
    faces: Faces
    finger1: str | None = None


@dataclass(frozen=True)
class BodyPose:
    position_m: tuple[float, float, float]
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def rpy_rad(self) -> tuple[float, float, float]:
        roll, pitch, yaw = self.rpy_deg
        return (math.radians(roll), math.radians(pitch), math.radians(yaw))


@dataclass(frozen=True)
class Gripper:
    """Where a gripper in the air is; opening: pad face to gripper centre."""

    position_m: tuple[float, float, float]
    yaw_deg: float
    opening_m: float

    @property
    def yaw_rad(self) -> float:
        return math.radians(self.yaw_deg)


@dataclass(frozen=True)
class Start:
    """Patch model: every limb has a grasp or is in the air. Point model: a foot on the wall (x, y) for every limb."""

    body: BodyPose
    grasps: dict[str, Grasp] = field(default_factory=dict)
    air: dict[str, Gripper] = field(default_factory=dict)
    feet: dict[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Goal:
    body: BodyPose
    tolerance_m: float = 0.01
    tolerance_deg: float = 3.0
    grasps: dict[str, Grasp] = field(default_factory=dict)

    @property
    def tolerance_rad(self) -> float:
        return math.radians(self.tolerance_deg)


@dataclass(frozen=True)
class Horizon:
    steps: int
    dt_s: float

    @property
    def duration_s(self) -> float:
        return self.steps * self.dt_s


@dataclass(frozen=True)
class Uncertainty:
    """What a plan has to hold for: each number is how far off, either way, something may be (`sigmas` in it)."""

    friction: float = 0.0  # share of every face's friction
    hold_position_m: float = 0.0  # along x and y of W, each
    hold_yaw_rad: float = 0.0
    mass_kg: float = 0.0
    centre_of_mass_m: float = 0.0  # along each axis


@dataclass(frozen=True)
class PlannerOptions:
    """None: the planner's own choice."""

    method: str = "auto"
    rho: float | None = None
    iterations: int | None = None
    time_limit_s: float | None = None
    limit_surface: str = "cone"
    idle: str = "cut"
    weights: dict[str, float] = field(default_factory=dict)
    margins: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Scenario:
    name: str
    robot: str
    wall: Wall
    contact: Contact
    holds: tuple[Hold, ...]
    obstacles: tuple[Obstacle, ...]
    start: Start
    goal: Goal
    horizon: Horizon
    planner: PlannerOptions
    uncertainty: Uncertainty | None
    yaml_text: str = field(repr=False)
    path: str = "scenario"

    @property
    def sha256(self) -> str:
        """Of the file's bytes."""
        return hashlib.sha256(self.yaml_text.encode("utf-8")).hexdigest()

    @property
    def cuboids(self) -> tuple[Cuboid, ...]:
        """Holds, then obstacles: the order of plan_t.holds."""
        return (*self.holds, *self.obstacles)

    def hold_index(self, name: str) -> int:
        """Index of a hold by name; KeyError for an unknown one."""
        for index, hold in enumerate(self.holds):
            if hold.name == name:
                return index
        raise KeyError(name)
