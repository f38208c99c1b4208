"""The sections of robot.yaml as typed values: one field a key, so a new key in the file needs its field here.

Units stand in the names. A number is finite and not negative; an Interval is [low, high] of any sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Interval = tuple[float, float]
PerJoint = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Can:
    rate_Hz: float
    nodes: dict[str, int]
    bit_rate: int
    data_bit_rate: int
    watchdog_cycles: int

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
    torque_time_constant_s: float
    armature_kg_m2: PerJoint
    damping_Nms_rad: PerJoint
    friction_Nm: PerJoint
    max_deceleration_rad_s2: float
    temperature_limit_degC: float


@dataclass(frozen=True)
class Gripper:
    opening_m: Interval
    open_opening_m: float
    max_finger_force_N: float
    max_finger_speed_m_s: float
    stiffness_N_m: float
    damping_Ns_m: float
    moving_mass_kg: float
    screw_damping_Ns_m: float
    temperature_limit_degC: float
    pad_radius_m: float
    finger_height_m: float


@dataclass(frozen=True)
class Drive:
    """Of every node's board."""

    supply_V: float
    encoder_counts: int


@dataclass(frozen=True)
class Motor:
    """Three-phase machine with surface magnets. Currents count amplitudes, resistance and inductance one phase."""

    pole_pairs: int
    resistance_ohm: float
    inductance_H: float
    torque_constant_Nm_A: float
    continuous_current_A: float
    heating_time_s: float
    max_speed_rad_s: float

    @property
    def flux_Wb(self) -> float:
        """Peak flux of the magnets through a phase: torque = 3/2 pole pairs flux current."""
        return self.torque_constant_Nm_A / (1.5 * self.pole_pairs)


@dataclass(frozen=True)
class JointMotor(Motor):
    gear_ratio: float
    gear_efficiency: float

    def current_A(self, joint_torque_Nm: float) -> float:
        """Amplitude that makes a torque of the joint."""
        return joint_torque_Nm / (self.gear_ratio * self.gear_efficiency * self.torque_constant_Nm_A)

    @property
    def continuous_torque_Nm(self) -> float:
        """Of the joint, as far as the winding bears it."""
        return self.continuous_current_A * self.gear_ratio * self.gear_efficiency * self.torque_constant_Nm_A


@dataclass(frozen=True)
class GripperMotor(Motor):
    screw_lead_m: float
    screw_efficiency: float
    screw_release_torque: float
    coarse_travel_m: float

    def current_A(self, finger_force_N: float) -> float:
        """Amplitude that builds a squeeze of both fingers."""
        rotor_torque_Nm = 2 * finger_force_N * self.screw_lead_m / (2 * math.pi * self.screw_efficiency)
        return rotor_torque_Nm / self.torque_constant_Nm_A

    def of_both_fingers(self, at_finger: float) -> float:
        """Mass [kg] or damping [Ns/m] a finger as inertia [kg m2] or drag [Nms/rad] of the rotor."""
        return 2 * at_finger * (self.screw_lead_m / (2 * math.pi)) ** 2


@dataclass(frozen=True)
class ForceTorque:
    range_N: float
    range_Nm: float
    noise_N: float
    noise_Nm: float
    bias_N: float
    bias_Nm: float


@dataclass(frozen=True)
class Body:
    height_m: Interval
    max_tilt_rad: float
    max_speed_m_s: float
    max_rate_rad_s: float


@dataclass(frozen=True)
class GraspLimits:
    gripper_yaw_rad: Interval
    approach_speed_m_s: float
    yaw_rate_rad_s: float
    pad_height_m: Interval
    swing_clearance_m: float
    max_swing_height_m: float


@dataclass(frozen=True)
class Walking:
    max_speed_m_s: float
    max_rate_rad_s: float
    foot_speed_m_s: float
    foot_yaw_rate_rad_s: float
    step_height_m: float
    foot_yaw_rad: Interval


@dataclass(frozen=True)
class Admittance:
    mass_kg: float
    damping_Ns_m: float
    stiffness_N_m: float
    inertia_kg_m2: float
    rotational_damping_Nms_rad: float
    rotational_stiffness_Nm_rad: float
    max_speed_m_s: float
    max_rate_rad_s: float
    max_offset_m: float
    max_rotation_rad: float
    environment_N_m: float
    environment_Nm_rad: float
    delay_s: float


@dataclass(frozen=True)
class Calibration:
    """Of the admittance's gains."""

    window_s: float
    tolerated_N: float
    tolerated_Nm: float
    max_change: float


@dataclass(frozen=True)
class Control:
    force_filter_s: float
    tare_time_constant_s: float
    contact_force_N: float
    unload_force_N: float
    grasp_force_factor: float
    grasp_force_reserve_N: float
    trusted_friction: float
    min_grasp_force_N: float
    grasp_damping_Ns_m: float
    grasp_force_time_constant_s: float
    grasp_force_lead_s: float
    closing_speed_m_s: float
    body_gain_1_s: float
    max_body_correction_m: float
    max_body_rotation_rad: float
    twist_length_m: float
    moment_length_m: float
    swing_decay_s: float
    engage_time_s: float
    max_contact_offset_m: float


@dataclass(frozen=True)
class Localisation:
    """Standard deviations."""

    hold_sigma_m: float
    grasp_sigma_m: float
    grasp_sigma_rad: float
    tilt_sigma_rad: float


@dataclass(frozen=True)
class Stance:
    """Rigid fit of the grips."""

    shift_sigma_m: float
    turn_sigma_rad: float
    idle_torque_Nm: float
    most_play_rad: float
    play_memory_s: float
    slip_m: float
    max_slip_m: float
    still_time_s: float
    relief_load: float
    max_misfit_m: float
    balance_memory_s: float
    max_unbalanced_N: float
    unbalanced_time_s: float


@dataclass(frozen=True)
class SupervisorLimits:
    start_tolerance_m: float
    start_tolerance_rad: float
    settle_time_s: float
    event_timeout_s: float
    arrive_tolerance_m: float
    open_tolerance_m: float
    silent_cycles: int
    max_body_error_m: float
    max_tracking_error_rad: float
    min_stance_force_N: float
    max_ik_error_m: float
    encoder_standstill_rad: float
    max_ft_residual_Nm: float
    max_ft_residual_share: float
    max_finger_residual_N: float
    max_late_s: float
    persistence_s: float


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
