"""The sections of robot.yaml as typed values: one field a key, so a new key in the file needs its field here.

Units stand in the names. A number is finite and not negative; an Interval is [low, high] of any sign. Lengths and
angles are within what a robot has (robot_bounds.py). The runtime checks the same: `key_rules` becomes a table of its.
"""

from __future__ import annotations

import math
import typing
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated

from .robot_bounds import MAX_ANGLE_RAD, MAX_LENGTH_M

MIN_NUMBER, MAX_NUMBER = 1e-9, 1e9  # of what must be above 0


@dataclass(frozen=True)
class Range:
    """Of a number, low..high."""

    low: float = 0.0
    high: float = MAX_NUMBER


Positive = Annotated[float, Range(MIN_NUMBER)]
Share = Annotated[float, Range(MIN_NUMBER, 1.0)]
Count = Annotated[int, Range(1)]
Interval = tuple[float, float]
PerJoint = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Can:
    rate_Hz: Positive
    nodes: dict[str, int]
    bit_rate: Count
    data_bit_rate: Count
    watchdog_cycles: Count

    @property
    def dt_s(self) -> float:
        """Of a control cycle."""
        return 1.0 / self.rate_Hz


@dataclass(frozen=True)
class Servo:
    """One value a joint, shoulder outwards."""

    position_gain_Nm_rad: PerJoint
    velocity_gain_Nms_rad: PerJoint
    continuous_torque_Nm: PerJoint
    setpoint_time_constant_s: float
    torque_time_constant_s: Positive
    dead_time_s: float
    armature_kg_m2: PerJoint
    damping_Nms_rad: PerJoint
    friction_Nm: PerJoint
    max_deceleration_rad_s2: float
    temperature_limit_degC: float


@dataclass(frozen=True)
class Gripper:
    opening_m: Interval
    open_opening_m: Positive
    max_finger_force_N: Positive
    max_finger_speed_m_s: Positive
    stiffness_N_m: Positive
    damping_Ns_m: float
    moving_mass_kg: float
    screw_damping_Ns_m: float
    temperature_limit_degC: float
    pad_radius_m: Positive
    finger_height_m: float


@dataclass(frozen=True)
class Drive:
    """Of every node's board."""

    supply_V: Positive
    encoder_counts: Annotated[int, Range(64, 65536)]


@dataclass(frozen=True)
class Motor:
    """Three-phase machine with surface magnets. Currents count amplitudes, resistance and inductance one phase."""

    pole_pairs: Annotated[int, Range(1, 50)]
    resistance_ohm: Positive
    inductance_H: Positive
    torque_constant_Nm_A: Positive
    continuous_current_A: Positive
    heating_time_s: Positive
    max_speed_rad_s: Positive

    @property
    def flux_Wb(self) -> float:
        """Peak flux of the magnets through a phase: torque = 3/2 pole pairs flux current."""
        return self.torque_constant_Nm_A / (1.5 * self.pole_pairs)


@dataclass(frozen=True)
class JointMotor(Motor):
    gear_ratio: Positive
    gear_efficiency: Share

    def current_A(self, joint_torque_Nm: float) -> float:
        """Amplitude that makes a torque of the joint."""
        return joint_torque_Nm / (self.gear_ratio * self.gear_efficiency * self.torque_constant_Nm_A)

    @property
    def continuous_torque_Nm(self) -> float:
        """Of the joint, as far as the winding bears it."""
        return self.continuous_current_A * self.gear_ratio * self.gear_efficiency * self.torque_constant_Nm_A


@dataclass(frozen=True)
class GripperMotor(Motor):
    screw_lead_m: Positive
    screw_efficiency: Share
    screw_release_torque: Share
    coarse_travel_m: Positive

    def current_A(self, finger_force_N: float) -> float:
        """Amplitude that builds a squeeze of both fingers."""
        rotor_torque_Nm = 2 * finger_force_N * self.screw_lead_m / (2 * math.pi * self.screw_efficiency)
        return rotor_torque_Nm / self.torque_constant_Nm_A

    def of_both_fingers(self, at_finger: float) -> float:
        """Mass [kg] or damping [Ns/m] a finger as inertia [kg m2] or drag [Nms/rad] of the rotor."""
        return 2 * at_finger * (self.screw_lead_m / (2 * math.pi)) ** 2


@dataclass(frozen=True)
class ForceTorque:
    range_N: Positive
    range_Nm: Positive
    noise_N: float
    noise_Nm: float
    bias_N: float
    bias_Nm: float


@dataclass(frozen=True)
class Body:
    height_m: Interval
    max_tilt_rad: float
    max_speed_m_s: Positive
    max_rate_rad_s: Positive


@dataclass(frozen=True)
class GraspLimits:
    gripper_yaw_rad: Interval
    approach_speed_m_s: Positive
    yaw_rate_rad_s: Positive
    pad_height_m: Interval
    swing_clearance_m: float
    max_swing_height_m: Positive


@dataclass(frozen=True)
class Walking:
    max_speed_m_s: Positive
    max_rate_rad_s: Positive
    foot_speed_m_s: Positive
    foot_yaw_rate_rad_s: Positive
    step_height_m: Positive
    foot_yaw_rad: Interval


@dataclass(frozen=True)
class Admittance:
    mass_kg: Positive
    damping_Ns_m: Positive
    stiffness_N_m: float
    inertia_kg_m2: Positive
    rotational_damping_Nms_rad: Positive
    rotational_stiffness_Nm_rad: float
    max_speed_m_s: Positive
    max_rate_rad_s: Positive
    max_offset_m: Positive
    max_rotation_rad: Positive
    environment_N_m: Positive
    environment_Nm_rad: Positive
    delay_s: Positive


@dataclass(frozen=True)
class Calibration:
    """Of the admittance's gains."""

    window_s: Positive
    tolerated_N: Positive
    tolerated_Nm: Positive
    max_change: Positive


@dataclass(frozen=True)
class Control:
    force_filter_s: Positive
    tare_time_constant_s: Positive
    contact_force_N: Positive
    unload_force_N: Positive
    grasp_force_factor: Positive
    grasp_force_reserve_N: float
    trusted_friction: Positive
    min_grasp_force_N: Positive
    grasp_damping_Ns_m: Positive
    grasp_force_time_constant_s: Positive
    grasp_force_lead_s: float
    closing_speed_m_s: Positive
    body_gain_1_s: float
    max_body_correction_m: Positive
    max_body_rotation_rad: Positive
    twist_length_m: Positive
    moment_length_m: Positive
    swing_decay_s: Positive
    engage_time_s: Positive
    max_contact_offset_m: Positive


@dataclass(frozen=True)
class Localisation:
    """Standard deviations."""

    hold_sigma_m: Positive
    grasp_sigma_m: float
    grasp_sigma_rad: float
    tilt_sigma_rad: Positive


@dataclass(frozen=True)
class Stance:
    """Rigid fit of the grips."""

    shift_sigma_m: Positive
    turn_sigma_rad: Positive
    idle_torque_Nm: float
    most_play_rad: float
    play_memory_s: Positive
    slip_m: Positive
    max_slip_m: Positive
    still_time_s: Positive
    relief_load: float
    max_misfit_m: Positive
    balance_memory_s: Positive
    max_unbalanced_N: Positive
    unbalanced_time_s: Positive


@dataclass(frozen=True)
class SupervisorLimits:
    start_tolerance_m: Positive
    start_tolerance_rad: Positive
    settle_time_s: Positive
    event_timeout_s: Positive
    arrive_tolerance_m: Positive
    open_tolerance_m: Positive
    silent_cycles: Count
    max_body_error_m: Positive
    max_tracking_error_rad: Positive
    min_stance_force_N: Positive
    max_ik_error_m: Positive
    oscillation_rad: Positive
    encoder_standstill_rad: Positive
    max_ft_residual_Nm: Positive
    max_ft_residual_share: Positive
    max_finger_residual_N: Positive
    max_late_s: Positive
    persistence_s: Positive


SECTIONS = {
    "can": Can,
    "servo": Servo,
    "gripper": Gripper,
    "drive": Drive,
    "motor": JointMotor,
    "gripper_motor": GripperMotor,
    "force_torque": ForceTorque,
    "body": Body,
    "grasp": GraspLimits,
    "walking": Walking,
    "admittance": Admittance,
    "calibration": Calibration,
    "control": Control,
    "localisation": Localisation,
    "stance": Stance,
    "supervisor": SupervisorLimits,
}


@dataclass(frozen=True)
class KeyRule:
    """What a key of a section may hold. `kind` is number, integer, per_joint, interval or nodes."""

    section: str
    key: str
    kind: str
    range: Range
    unit: str  # m or rad, else empty: of numbers that are often written in another unit


@cache
def key_rules() -> tuple[KeyRule, ...]:
    """All keys of all sections, in the order of the fields."""
    found = []
    for section, kind in SECTIONS.items():
        hints = typing.get_type_hints(kind, include_extras=True)
        found += [_rule(section, field.name, hints[field.name]) for field in fields(kind)]
    return tuple(found)


def _rule(section: str, key: str, hint: object) -> KeyRule:
    plain = typing.get_args(hint)[0] if typing.get_origin(hint) is Annotated else hint
    given = getattr(hint, "__metadata__", (Range(),))[0]
    kinds = {float: "number", int: "integer", PerJoint: "per_joint", Interval: "interval"}
    *before, unit = key.split("_")
    if unit not in ("m", "rad") or not before or before[-1] in ("N", "Ns", "Nm", "Nms"):
        unit = ""
    high = min(given.high, {"m": MAX_LENGTH_M, "rad": MAX_ANGLE_RAD}.get(unit, MAX_NUMBER))
    low = -high if plain == Interval else given.low
    return KeyRule(section, key, kinds.get(plain, "nodes"), Range(low, high), unit)
