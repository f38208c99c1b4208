"""ctypes binding of libcrux_sim.so: physics of a climb, and the runtime in this process (tools/sim/*.h say more)."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_ubyte, c_uint64, c_void_p
from functools import cache
from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.robot_bounds import MOST_JOINTS as JOINTS_PER_LIMB
from crux_tools.paths import built

LIBRARY = "tools/sim/libcrux_sim.so"
LIMBS = len(LIMB_NAMES)
JOINTS, PADS, WRENCHES = JOINTS_PER_LIMB * LIMBS, 2 * LIMBS, 6 * LIMBS


class PlantMap(ctypes.Structure):
    """crux_plant_map."""

    _fields_ = [
        ("body", c_int32),
        ("slots", c_int32),
        *((name, c_int32 * JOINTS) for name in ("driven_qpos", "driven_dof", "joint_actuators")),
        *((name, c_double * JOINTS) for name in ("ratio", "coupling", "offset_rad")),
        *((name, c_int32 * JOINTS) for name in ("coupled_to", "tendon")),
        *((name, c_int32 * PADS) for name in ("finger_qpos", "finger_dof", "finger_actuators", "spine_actuators")),
        ("ft_sensors", c_int32 * WRENCHES),
        ("gripper_sites", c_int32 * LIMBS),
        ("pad_geoms", c_int32 * PADS),
        ("pad_of_geom", c_void_p),
        ("face_of_geom", c_void_p),
        ("adhesion_of_face", c_void_p),
    ]


class PlantSettings(ctypes.Structure):
    """crux_plant_settings."""

    _fields_ = [
        ("seed", c_uint64),
        ("torque_share", c_double),
        ("ft_noise", c_double * 6),
        ("ft_bias", c_double * 6),
        *((name, c_double) for name in ("encoder_step_rad", "encoder_noise_rad", "encoder_noise_rad_s")),
        ("hand_rotation", c_double * 9),
        ("screw_middle", c_double),
        ("screw_width", c_double),
        ("braking_nms_rad", c_double),
        ("idle_friction_nm", c_double),
    ]


class SensorErrorRow(ctypes.Structure):
    """crux_sensor_error."""

    _fields_ = [
        *((name, c_int32) for name in ("sensor", "place", "fault")),
        ("value", c_double * 6),
        ("from_s", c_double),
        ("until_s", c_double),
    ]


class PushRow(ctypes.Structure):
    """crux_push."""

    _fields_ = [("wrench_w", c_double * 6), ("from_s", c_double), ("until_s", c_double)]


class HoldBreakRow(ctypes.Structure):
    """crux_hold_break."""

    _fields_ = [("body", c_int32), ("load_n", c_double), ("at_s", c_double)]


class PlantWorld(ctypes.Structure):
    """crux_world."""

    _fields_ = [
        *(
            (name, c_double * JOINTS)
            for name in (
                *("torque_factor", "torque_limit_nm", "torque_share", "half_play_rad", "stiffness_nm_rad"),
                *("stiction_nm", "heating_k_nm2", "heating_time_s"),
            )
        ),
        *((name, c_int32 * JOINTS) for name in ("dead_cycles", "play_qpos", "play_dof")),
        *((name, c_double * LIMBS) for name in ("finger_force_factor", "finger_force_limit_n", "jam_m", "jam_s")),
        ("ft_range", c_double * 6),
        ("ambient_degc", c_double),
        ("gone_m", c_double),
        *((f"{name}_count", c_int32) for name in ("sensor_errors", "pushes", "breaks")),
        ("sensor_errors", POINTER(SensorErrorRow)),
        ("pushes", POINTER(PushRow)),
        ("breaks", POINTER(HoldBreakRow)),
    ]


class PlantState(ctypes.Structure):
    """crux_plant_state."""

    _fields_ = [
        *((name, c_double * JOINTS) for name in ("joint_position_rad", "joint_velocity_rad_s", "joint_torque_nm")),
        *((name, c_double * LIMBS) for name in ("finger_opening_m", "finger_speed_m_s", "finger_force_n")),
        ("ft", c_double * WRENCHES),
        ("ft_true", c_double * WRENCHES),
        ("pad_force_n", c_double * PADS),
        ("link_contact_force_n", c_double),
        ("pad_face", c_int64 * PADS),
        ("cycle", c_int64),
    ]


class PlantTruth(ctypes.Structure):
    """crux_plant_truth."""

    _fields_ = [
        ("cycle", c_int64),
        ("climbing", c_int64),
        ("body_position_m", c_double * 3),
        ("body_quaternion", c_double * 4),
        ("gripper_position_m", c_double * 3 * LIMBS),
        ("gripper_rotation", c_double * 9 * LIMBS),
        ("pad_position_m", c_double * 3 * PADS),
        ("pad_force_n", c_double * PADS),
        ("pad_face", c_int64 * PADS),
        ("hand_wrench_g", c_double * 6 * LIMBS),
        ("link_contact_force_n", c_double),
    ]


@cache
def library() -> Any:
    """The library, with the signatures of its functions."""
    loaded = ctypes.CDLL(str(built(LIBRARY)))
    handle, doubles = c_void_p, POINTER(c_double)
    signatures: dict[str, tuple[Any, list[Any]]] = {
        "plant_open": (
            handle,
            [handle, handle, POINTER(PlantMap), POINTER(PlantSettings), POINTER(PlantWorld), POINTER(PlantState)],
        ),
        "plant_close": (None, [handle]),
        "plant_drive_joint": (None, [handle, c_int32]),
        "plant_drive_gripper": (None, [handle, c_int32]),
        "plant_power_joint": (None, [handle, c_int32, c_int32]),
        "plant_power_gripper": (None, [handle, c_int32, c_int32]),
        "plant_step": (None, [handle, doubles, doubles]),
        "plant_temperature": (doubles, [handle]),
        "plant_record": (None, [handle, c_int64, c_int32]),
        "plant_recorded": (POINTER(PlantTruth), [handle, POINTER(c_int64)]),
        "runtime_open": (handle, [handle, c_int32, POINTER(c_char_p)]),
        "runtime_error": (c_char_p, []),
        "runtime_turn": (c_int32, [handle]),
        "runtime_tell": (None, [handle, c_char_p, c_char_p, c_int32]),
        "runtime_next": (POINTER(c_ubyte), [handle, POINTER(c_int32)]),
        "runtime_finish": (c_char_p, [handle]),
        "runtime_close": (None, [handle]),
        "sim_step": (None, [handle, handle, c_double]),
        "sim_publish": (c_int32, [handle, handle]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(loaded, f"crux_{name}")
        function.restype, function.argtypes = result, arguments
    return loaded


def contact_period() -> int:
    """Steps between two looks at the contacts."""
    return int(c_int32.in_dll(library(), "crux_plant_contact_period").value)
