"""A world, its numbers fixed: what differs in truth from what the plan says. Only the physics of a climb knows it."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, field, fields
from typing import Any

import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.records import REQUIRED, Key, key
from crux_contracts.robot_bounds import MOST_JOINTS
from crux_contracts.scenario import MAX_FRICTION
from crux_contracts.yaml_document import DocumentError

VERSION = 1


def joint_names(slots: int) -> tuple[str, ...]:
    """Of joints, limb by limb, so many of each."""
    return tuple(f"{limb}.{joint}" for limb in LIMB_NAMES for joint in range(1, slots + 1))


JOINT_NAMES = joint_names(MOST_JOINTS)
MAX_TIME_S = 3600.0
AMBIENT_DEGC = 25.0
HAND_GONE_S = 2.0  # START: the hand that sets the robot on the wall is gone

Vector = tuple[float, ...]
ZERO: Vector = (0.0, 0.0, 0.0)


class WorldError(DocumentError):
    """A world file that cannot be used; str() names file, line, key, value and what would be right."""


def _time(default: Any, low: float = 0.0) -> Any:
    return key(default, low, MAX_TIME_S, "s")


@dataclass(frozen=True)
class HoldChange:
    """How a hold or obstacle differs from its place in the plan; offset and change of size in its own frame."""

    offset_m: tuple[float, ...] = key(ZERO, -1.0, 1.0, "m")
    yaw_deg: float = key(0.0, -180.0, 180.0, "degrees")
    size_change_m: tuple[float, ...] = key(ZERO, -1.0, 1.0, "m")
    corner_cut_m: tuple[float, ...] = key((0.0, 0.0), -1.0, 1.0, "m")
    """along x and y, from the corner on the side of their signs: what is beyond is missing, over the whole height"""
    friction_factor: float = key(1.0, 0.0, 10.0)
    friction: dict[str, float] = key(dict, 0.0, MAX_FRICTION)
    """by face, in place of the plan's"""
    spines: dict[str, bool] = key(dict)
    """by face: whether they grip"""
    stiffness_N_m: float = key(math.inf, 1e3, 2e5, "N/m")
    """along each axis, of what fixes it to the wall"""
    viscosity_Ns_m: float = key(math.inf, 1e3, 1e9, "Ns/m")
    """along each axis, of what fixes it to the wall: it creeps at force over viscosity"""
    present: bool = key(True)
    breaks_at_N: float = key(math.inf, 0.0, 1e4, "N")
    breaks_at_s: float = _time(math.inf)


@dataclass(frozen=True)
class JointChange:
    """How a joint's drive differs from the robot description."""

    torque_factor: float = key(1.0, 0.0, 2.0)
    torque_limit_Nm: float = key(math.inf, 0.0, 100.0, "Nm")
    lag_s: float = key(0.0, 0.0, 0.2, "s")
    dead_cycles: float = key(0.0, 0.0, 16.0, "cycles")
    setpoint_time_constant_s: float | None = key(None, 0.002, 0.5, "s")
    friction_Nm: float = key(0.0, 0.0, 20.0, "Nm")
    stiction_Nm: float = key(0.0, 0.0, 20.0, "Nm")
    backlash_rad: float = key(0.0, 0.0, 0.2, "rad")
    stiffness_Nm_rad: float = key(math.inf, 50.0, 5000.0, "Nm/rad")
    heating_K_Nm2: float = key(0.0, 0.0, 100.0, "K/Nm²")
    heating_time_s: float = key(30.0, 0.1, 1e4, "s")

    @property
    def mechanical(self) -> bool:
        """Whether it changes what lies between motor and link."""
        return self.friction_Nm + self.stiction_Nm + self.backlash_rad > 0 or math.isfinite(self.stiffness_Nm_rad)


@dataclass(frozen=True)
class GripperChange:
    """How a gripper's drive differs from the robot description."""

    force_factor: float = key(1.0, 0.0, 2.0)
    force_limit_N: float = key(math.inf, 0.0, 1000.0, "N")
    speed_limit_m_s: float = key(math.inf, 1e-4, 1.0, "m/s")
    jams_at_m: float | None = key(None, 0.0, 0.1, "m")
    jams_at_s: float = _time(math.inf)


@dataclass(frozen=True)
class Payload:
    """A point mass on the body, at a place in the body's frame."""

    mass_kg: float = key(0.0, 0.0, 20.0, "kg")
    position_m: tuple[float, ...] = key(ZERO, -1.0, 1.0, "m")


@dataclass(frozen=True)
class Push:
    """Force and moment on the body's centre of mass, frame W."""

    at_s: float = _time(REQUIRED, HAND_GONE_S)
    for_s: float = _time(REQUIRED)
    force_N: tuple[float, ...] = key(ZERO, -1000.0, 1000.0, "N")
    moment_Nm: tuple[float, ...] = key(ZERO, -1000.0, 1000.0, "Nm")


@dataclass(frozen=True)
class SensorError:
    """What one sensor says wrongly, from `from_s` on for `for_s`."""

    sensor: str
    on: str
    """limb or joint"""
    error: str
    values: Vector = ()
    """one a channel, in the units of SENSORS; of SHARES: one number"""
    from_s: float = 0.0
    for_s: float = math.inf

    def as_dict(self) -> dict[str, Any]:
        """Its entry in a file."""
        entry: dict[str, Any] = {"sensor": self.sensor, "on": self.on, "error": self.error}
        if self.error in SHARES:
            entry[SHARES[self.error][0]] = self.values[0]
        elif self.error in BY_CHANNEL:
            begin = 0
            for unit, (count, _) in SENSORS[self.sensor].items():
                values = list(self.values[begin : begin + count])
                begin += count
                if math.isfinite(values[0]):
                    entry[unit] = values if count > 1 else values[0]
        if self.from_s > 0:
            entry["from_s"] = self.from_s
        return entry | ({"for_s": self.for_s} if math.isfinite(self.for_s) else {})


SENSORS: dict[str, dict[str, tuple[int, float]]] = {
    "force_torque": {"N": (3, 1000.0), "Nm": (3, 100.0)},
    "encoder": {"rad": (1, 10.0)},
    "finger_opening": {"m": (1, 0.1)},
    "finger_force": {"N": (1, 1000.0)},
}
"""Channels of a sensor by their unit: how many, and the most that an error may be."""
BY_CHANNEL = ("bias", "jump", "drift", "saturation")
SHARES = {
    "scale": ("factor", Key(-10.0, 10.0)),
    "cross_talk": ("share", Key(-1.0, 1.0)),
    "dropout": ("share", Key(0.0, 1.0)),
}
ERRORS = (*BY_CHANNEL, *SHARES, "freeze", "zero", "nan")


@dataclass(frozen=True)
class World:
    """A world with all numbers fixed; holds by name as in the plan, joints and grippers by place, where they differ."""

    name: str
    source_sha256: str
    """of the file it was drawn from"""
    seed: int
    holds: dict[str, HoldChange] = field(default_factory=dict)
    payload: Payload = Payload()
    ambient_degC: float = AMBIENT_DEGC
    joints: dict[str, JointChange] = field(default_factory=dict)
    grippers: dict[str, GripperChange] = field(default_factory=dict)
    sensors: tuple[SensorError, ...] = ()
    pushes: tuple[Push, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """What its file would hold; what does not differ is left out."""
        robot = {
            "payload": _differing(self.payload),
            "ambient_degC": self.ambient_degC,
            "joints": _differing_each(self.joints),
            "grippers": _differing_each(self.grippers),
        }
        sections = {
            "holds": _differing_each(self.holds),
            "robot": {key: value for key, value in robot.items() if value not in ({}, AMBIENT_DEGC)},
            "sensors": [error.as_dict() for error in self.sensors],
            "pushes": [_differing(push) for push in self.pushes],
        }
        return {"version": VERSION, "name": self.name, **{key: part for key, part in sections.items() if part}}

    def as_yaml(self) -> str:
        """A world file that gives this world again, whatever the seed."""
        said = f"# Drawn from the world with sha256 {self.source_sha256}, seed {self.seed}.\n"
        return said + yaml.safe_dump(self.as_dict(), sort_keys=False, allow_unicode=True)


def _differing(change: Any) -> dict[str, Any]:
    """The keys of a dataclass that are not at their default."""
    found = {}
    for each in fields(change):
        value = getattr(change, each.name)
        default = each.default_factory() if each.default_factory is not MISSING else each.default
        if value != default:
            found[each.name] = list(value) if isinstance(value, tuple) else value
    return found


def _differing_each(changes: dict[str, Any]) -> dict[str, Any]:
    return {name: found for name, change in changes.items() if (found := _differing(change))}
