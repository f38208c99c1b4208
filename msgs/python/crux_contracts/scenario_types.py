"""A scenario as typed values, with what each key of its file may hold. Frame W: z off the wall, x up the slope."""

from __future__ import annotations

import hashlib
import itertools
import math
from dataclasses import dataclass, field

from . import LIMB_NAMES
from .records import REQUIRED, key
from .yaml_document import DocumentError

VERSIONS = (1, 2)  # of the file
FACE_NAMES = ("+x", "-x", "+y", "-y", "top")
METHODS = ("auto", "two_block", "multi_block", "benchmark")
LIMIT_SURFACES = ("cone", "inner", "paper")
OBJECTIVES = ("paper", "time", "balanced")
IDLE = ("cut", "keep")  # knots of a plan at which nothing moves
WEIGHTS = ("body", "position", "orientation", "velocity", "wrench", "lift", "opening", "switching")
MARGINS = ("friction", "clearance_m", "torque")
GRAVITY_M_S2 = 9.81
MAX_SLOPE_DEG = 180.0
MAX_POSITION_M = 1000.0
MAX_BODY_HEIGHT_M = 1.0
MAX_FRICTION = 5.0
MAX_CUBOIDS = 10_000
MAX_SURFACES = 50
MAX_LEAN_DEG = 50.0
LEAST_SHARE = 0.5
MOST_GRIPS = 16  # of a hold
MAX_GRIP_TILT_DEG = 45.0
MAX_GRAVITY_M_S2 = 30.0
MAX_STEPS = 1000
SIZE_M = (0.005, 2.0)
POSITION = (-MAX_POSITION_M, MAX_POSITION_M, "m")
TWIST_RADIUS_RATIO = 2.0 / 3.0
"""k / r_p of equation (2): exact for pure twist of a round patch under uniform pressure."""


class ScenarioError(DocumentError):
    """A scenario file that cannot be used; str() names file, line, key, value and what would be right."""


@dataclass(frozen=True)
class Cuboid:
    """Stands on the wall; one of a file of version 2 may be turned out of its plane, and off it."""

    name: str = key(REQUIRED, means="any text, each name once")
    position_m: tuple[float, float] = key(REQUIRED, *POSITION, "x, y of the centre of its foot on the wall")
    size_m: tuple[float, float, float] = key(REQUIRED, *SIZE_M, "m", "along its own axes")
    yaw_deg: float = key(0.0, -360.0, 360.0, "degrees", "rotation about W's z")
    tilt_deg: tuple[float, float] = field(default=(0.0, 0.0), kw_only=True)
    """roll and pitch: R = Rz(yaw) Ry(pitch) Rx(roll) about the middle of its foot turns W <- the cuboid's own axes"""
    foot_z_m: float = field(default=0.0, kw_only=True)
    """of the middle of its foot, off the wall"""

    @property
    def yaw_rad(self) -> float:
        return math.radians(self.yaw_deg)

    @property
    def tilt_rad(self) -> tuple[float, float]:
        roll, pitch = self.tilt_deg
        return (math.radians(roll), math.radians(pitch))

    @property
    def turned(self) -> bool:
        """Whether it is not upright on the wall."""
        return any(self.tilt_deg) or self.foot_z_m != 0.0


@dataclass(frozen=True)
class Slab(Cuboid):
    """The solid behind a bounded surface, which is its top."""

    friction: float = 0.6


@dataclass(frozen=True)
class Wall:
    slope_deg: float = key(REQUIRED, 0.0, MAX_SLOPE_DEG, "degrees", "0 floor, 90 vertical, 180 ceiling")
    friction: float = key(0.6, 0.0, MAX_FRICTION, "", "of the surface itself, for feet")
    given_w_m_s2: tuple[float, float, float] | None = None  # gravity, where a file of version 2 has it as a vector
    slabs: tuple[Slab, ...] = ()  # of surfaces of version 2 that are bounded
    endless: bool = True  # whether the plane z = 0 of W is a surface, too

    @property
    def slope_rad(self) -> float:
        return math.radians(self.slope_deg)

    @property
    def gravity_w_m_s2(self) -> tuple[float, float, float]:
        """g in the wall's frame: 0 is the floor, 90 a vertical wall."""
        if self.given_w_m_s2 is not None:
            return self.given_w_m_s2
        return (-GRAVITY_M_S2 * math.sin(self.slope_rad), 0.0, -GRAVITY_M_S2 * math.cos(self.slope_rad))


@dataclass(frozen=True)
class Contact:
    """Patch: limit surface (2) with spines (3), a finger. Point: Coulomb friction of a foot on the wall."""

    model: str = key(REQUIRED, words=("patch", "point"), means="grippers on holds, or feet on the wall itself")
    patch_radius_m: float = key(0.02, 0.001, 0.1, "m", "of a finger's contact patch; bounds its twist")
    max_normal_N: float = key(60.0, 0.0, 1000.0, "N", "greatest normal force of a finger", above=True)
    spine_shear_N: float = key(0.0, 0.0, 200.0, "N", "what spines carry without any normal force")
    spine_twist_Nm: float = key(0.0, 0.0, 10.0, "Nm", "the same of a twist")
    spines_only: dict[str, int] = key(dict, 1, 2, "", "fingers that never press and hang by spines", words=LIMB_NAMES)

    @property
    def patch_k_m(self) -> float:
        """k of equation (2)."""
        return TWIST_RADIUS_RATIO * self.patch_radius_m


@dataclass(frozen=True)
class Grip:
    """A place for a gripper on a hold: the middle between its pads, along the hold's own axes off its foot's middle."""

    faces: str = key(REQUIRED, words=("x", "y"), means="the pair of faces: +x and -x, or +y and -y")
    aside_m: float = key(0.0, -SIZE_M[1], SIZE_M[1], "m", "along the faces: the hold's y on faces x, x on faces y")
    height_m: float | None = key(None, *SIZE_M, "m", "off the foot; without it as near the pads' mid-range as they fit")
    share: tuple[float, float] = key(
        (1.0, 1.0), LEAST_SHARE, 1.0, "", "of the pads that bears: on the plus face, the minus"
    )
    friction: tuple[float, float] | None = key(
        None, 0.0, MAX_FRICTION, "", "one, or under the pads on the plus face and the minus (the hold's)", reader="pads"
    )
    tilt_deg: float = key(
        0.0,
        -MAX_GRIP_TILT_DEG,
        MAX_GRIP_TILT_DEG,
        "degrees",
        "of the gripper off the hold's z, about +x or +y of it",
    )

    @property
    def tilt_rad(self) -> float:
        return math.radians(self.tilt_deg)


@dataclass(frozen=True)
class Hold(Cuboid):
    """A graspable cuboid. friction and spines follow FACE_NAMES."""

    friction: tuple[float, ...] = key((), 0.0, MAX_FRICTION, "", "one, or by face", required=True, reader="friction")
    spines: tuple[bool, ...] = key((True,) * 5, means="whether spines grip, of all or by face", reader="spines")
    lean_deg: tuple[float, ...] = (0.0,) * 4
    """of the side faces (+x, -x, +y, -y), in to the hold's middle: `size_m` is that of the foot, the top is smaller"""
    grips: tuple[Grip, ...] = ()
    """the only places for grippers; where there are none, any place on any pair of faces is one"""

    def grips_on(self, faces: str) -> tuple[Grip, ...]:
        """Those on a pair of faces, x or y: share and friction are the same for all of them."""
        return tuple(grip for grip in self.grips if grip.faces == faces)

    def places(self, faces: str) -> tuple[Grip | None, ...]:
        """Where a gripper may be on a pair of faces: at its grips; None stands for anywhere."""
        return self.grips_on(faces) if self.grips else (None,)

    @property
    def pad_share(self) -> tuple[float, ...]:
        """What of a pad bears on each side face (+x, -x, +y, -y): spines and k of (2) are so much less."""
        on_x, on_y = ([grip.share for grip in self.grips_on(faces)] or [(1.0, 1.0)] for faces in "xy")
        return (*on_x[0], *on_y[0])

    @property
    def lean_rad(self) -> tuple[float, ...]:
        return tuple(math.radians(each) for each in self.lean_deg)

    @property
    def leans(self) -> bool:
        return any(self.lean_deg)

    @property
    def tilted_grips(self) -> bool:
        """Whether a gripper on one of its grips is not along its z."""
        return any(grip.tilt_deg for grip in self.grips)


@dataclass(frozen=True)
class Foothold:
    """A place on a surface where a gripper may stand with both pads: it pushes, and never pulls. Of version 2."""

    name: str = key(REQUIRED, means="any text, each name once, of holds and obstacles too")
    position_m: tuple[float, float, float] = key(REQUIRED, *POSITION, "x, y, z in W: on a surface, to a millimetre")
    friction: float = 0.0
    """the surface's, as all that follows"""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """R = Rz(yaw) Ry(pitch) Rx(roll) turns W <- the surface's own axes, its normal last"""
    surface: str = ""
    """name of a bounded one; empty: the plane z = 0"""

    @property
    def rpy_rad(self) -> tuple[float, float, float]:
        roll, pitch, yaw = self.rpy_deg
        return (math.radians(roll), math.radians(pitch), math.radians(yaw))


@dataclass(frozen=True)
class Obstacle(Cuboid):
    """A cuboid to be kept clear of."""


@dataclass(frozen=True)
class Grasp:
    hold: str = key(REQUIRED, means="name of the hold")
    faces: str = key(REQUIRED, words=("x", "y"), means="the pair of faces: +x and -x, or +y and -y")
    finger1: str | None = key(None, words=FACE_NAMES[:4], means="face under finger 1, if both ways fit", reader="plain")
    grip: int | None = key(None, 0, MOST_GRIPS - 1, means="of a start: which of the hold's grips on these faces (any)")
    foothold: str = ""
    """name of the foothold on which the limb stands instead: then `hold` and `faces` are empty"""


@dataclass(frozen=True)
class Standing:
    """In place of a grasp, in a file of version 2."""

    foothold: str = key(REQUIRED, means="name of the foothold")


@dataclass(frozen=True)
class BodyPose:
    position_m: tuple[float, float, float] = key(REQUIRED, means="x, y, and height over the wall", reader="place")
    rpy_deg: tuple[float, float, float] = key((0.0, 0.0, 0.0), -180.0, 180.0, "degrees", "roll, pitch and yaw")

    @property
    def rpy_rad(self) -> tuple[float, float, float]:
        roll, pitch, yaw = self.rpy_deg
        return (math.radians(roll), math.radians(pitch), math.radians(yaw))


@dataclass(frozen=True)
class Gripper:
    """Where a gripper in the air is."""

    position_m: tuple[float, float, float] = key(REQUIRED, *POSITION, "of its centre")
    opening_m: float = key(REQUIRED, 0.0, 0.5, "m", "from a pad's face to the centre")
    yaw_deg: float = key(0.0, -360.0, 360.0, "degrees", "about W's z")

    @property
    def yaw_rad(self) -> float:
        return math.radians(self.yaw_deg)


@dataclass(frozen=True)
class Start:
    """Patch model: every limb has a grasp or is in the air. Point model: a foot on the wall for every limb."""

    body: BodyPose = key(REQUIRED, means="pose of the body")
    grasps: dict[str, Grasp] = key(dict, words=LIMB_NAMES, means="of every limb that is not in the air")
    air: dict[str, Gripper] = key(dict, words=LIMB_NAMES, means="grippers in the air, where they are")
    feet: dict[str, tuple[float, float]] = key(dict, *POSITION, "where the model is point", words=LIMB_NAMES)


@dataclass(frozen=True)
class GoalPose(BodyPose):
    tolerance_m: float = key(0.01, 0.0005, 0.2, "m", "how far off the body may end")
    tolerance_deg: float = key(3.0, 0.1, 45.0, "degrees", "the same of its attitude")


@dataclass(frozen=True)
class Goal:
    body: GoalPose = key(REQUIRED, means="pose of the body")
    grasps: dict[str, Grasp] = key(dict, words=LIMB_NAMES, means="which limb ends on which hold")

    @property
    def tolerance_m(self) -> float:
        return self.body.tolerance_m

    @property
    def tolerance_rad(self) -> float:
        return math.radians(self.body.tolerance_deg)


@dataclass(frozen=True)
class Horizon:
    steps: int = key(REQUIRED, 1, MAX_STEPS, means="the most steps; a move of one limb takes about 5 of 2 s")
    dt_s: float = key(REQUIRED, 0.01, 20.0, "s", "of a step")

    @property
    def duration_s(self) -> float:
        return self.steps * self.dt_s


@dataclass(frozen=True)
class Uncertainty:
    """What a plan has to hold for: each number is how far off, either way, something may be, `sigmas` counted in."""

    friction: float = key(0.0, 0.0, 0.95, "", "share of every face's friction")
    hold_position_m: float = key(0.0, 0.0, 0.05, "m", "along x and y of W, each; of a turned hold, along its own")
    hold_yaw_deg: float = key(0.0, 0.0, 30.0, "degrees", "yaw of a hold")
    mass_kg: float = key(0.0, 0.0, 20.0, "kg", "of the robot")
    centre_of_mass_m: float = key(0.0, 0.0, 0.1, "m", "along each axis")
    sigmas: float = key(1.0, 0.0, 10.0, "", "how many times the other numbers count", above=True)

    @property
    def hold_yaw_rad(self) -> float:
        return math.radians(self.hold_yaw_deg)

    @property
    def moves_holds(self) -> bool:
        """Whether holds may be elsewhere."""
        return self.hold_position_m > 0.0 or self.hold_yaw_deg > 0.0


@dataclass(frozen=True)
class PlannerOptions:
    """None: the planner's own choice."""

    method: str = key("auto", words=METHODS, means="auto, or the paper's")
    rho: float | None = key(None, 0.0, 1e6, "", "penalty of the ADMM methods", above=True)
    iterations: int | None = key(None, 1, 1000, means="most rounds of the ADMM methods")
    time_limit_s: float | None = key(None, 0.1, 86400.0, "s", "seconds of CPU, workers included")
    limit_surface: str = key("cone", words=LIMIT_SURFACES, means="(2), a polytope inside it, or (11), partly outside")
    objective: str = key("paper", words=OBJECTIVES, means="least J, or that climb in the least time, or in between")
    idle: str = key("cut", words=IDLE, means="leave out steps in which nothing moves, or use all of the horizon")
    weights: dict[str, float] = key(dict, 0.0, 1e9, words=WEIGHTS, means="of J; body sets position and orientation")
    margins: dict[str, float] = key(dict, 0.0, 1.0, words=MARGINS, means="kept in reserve")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """What is climbed or walked: the wall, the holds on it, where the robot is and where it shall be."""

    name: str = key(REQUIRED, means="shown in plans, logs and reports")
    robot: str = key(REQUIRED, means="a folder under msgs/robots or $CRUX_ROBOTS", reader="robot")
    wall: Wall = key(REQUIRED, means="the plane")
    contact: Contact = key(REQUIRED, means="how the robot holds on", reader="contact")
    holds: tuple[Hold, ...] = key((), most=MAX_CUBOIDS, means="cuboids over which grippers close")
    obstacles: tuple[Obstacle, ...] = key((), most=MAX_CUBOIDS, means="cuboids that nothing may touch; holds are, too")
    start: Start = key(REQUIRED, means="where the robot is", reader="start")
    goal: Goal = key(REQUIRED, means="where it shall be", reader="goal")
    horizon: Horizon = key(REQUIRED, means="steps of the plan")
    uncertainty: Uncertainty | None = key(None, means="of climbs: the plan holds at its corners", reader="uncertainty")
    planner: PlannerOptions = key(PlannerOptions(), means="how it is planned")
    footholds: tuple[Foothold, ...] = ()
    yaml_text: str = field(repr=False)
    path: str = "scenario"

    @property
    def sha256(self) -> str:
        """Of the file's bytes."""
        return hashlib.sha256(self.yaml_text.encode("utf-8")).hexdigest()

    @property
    def cuboids(self) -> tuple[Cuboid, ...]:
        """Holds, then obstacles: the order of plan_t.holds, in which footholds follow."""
        return (*self.holds, *self.obstacles)

    @property
    def leans(self) -> bool:
        """Whether some hold has a face that leans."""
        return any(hold.leans for hold in self.holds)

    @property
    def tilts(self) -> bool:
        """Whether some hold or foothold is turned out of the wall's plane, or a grip of one is at an angle."""
        return any(any(hold.tilt_deg) or hold.tilted_grips for hold in self.holds) or any(
            any(foothold.rpy_deg[:2]) for foothold in self.footholds
        )

    @property
    def not_upright(self) -> str:
        """The first foothold, surface that is bounded, hold or obstacle that leans or is turned, or hold on which pads
        bear in part or with a grip at an angle, in words; empty where all are upright on one endless wall, and grip.
        """
        bounded = (f"the surface {slab.name} is bounded" for slab in self.wall.slabs)
        leaning = (f"{hold.name} has faces that lean" for hold in self.holds if hold.leans)
        turned = (f"{each.name} is turned out of the wall's plane" for each in self.cuboids if each.turned)
        in_part = (f"pads bear in part on {hold.name}" for hold in self.holds if min(hold.pad_share) < 1.0)
        at_angles = (f"a grip of {hold.name} is at an angle" for hold in self.holds if hold.tilted_grips)
        stood_on = (f"limbs may stand on {foothold.name}" for foothold in self.footholds)
        return next(itertools.chain(leaning, turned, bounded, in_part, at_angles, stood_on), "")

    def hold_index(self, name: str) -> int:
        """Index of a hold by name; KeyError for an unknown one."""
        for index, hold in enumerate(self.holds):
            if hold.name == name:
                return index
        raise KeyError(name)

    def place_index(self, grasp: Grasp) -> int:
        """Index into plan_t.holds of what a limb grips or stands on; KeyError for an unknown name."""
        if not grasp.foothold:
            return self.hold_index(grasp.hold)
        for index, foothold in enumerate(self.footholds):
            if foothold.name == grasp.foothold:
                return len(self.cuboids) + index
        raise KeyError(grasp.foothold)
