/// Numbers of a node, all of them from the robot description; the core has none of its own.
#ifndef CRUX_FIRMWARE_PARAMETERS_H
#define CRUX_FIRMWARE_PARAMETERS_H

#include <stdint.h>

typedef struct crux_joint_parameters {
  float position_min_rad;
  float position_max_rad;
  float velocity_limit_rad_s;
  float torque_limit_Nm;
  float position_gain_Nm_rad;      ///< of a hold before the first TRACK command brings gains
  float velocity_gain_Nms_rad;     ///< as above
  float setpoint_time_constant_s;  ///< 0: no filter
  float max_deceleration_rad_s2;   ///< of the setpoint when the node stops by itself or on HOLD
  float temperature_limit_degC;
  uint32_t period_us;        ///< of the bus cycle
  uint32_t watchdog_cycles;  ///< silent bus cycles until the node stops by itself
} crux_joint_parameters;

typedef struct crux_gripper_parameters {
  float opening_min_m;  ///< pad face to gripper centre
  float opening_max_m;
  float speed_limit_m_s;
  float force_limit_N;  ///< a finger
  float stiffness_N_m;  ///< of the position loop, a finger
  float damping_Ns_m;
  float force_range_N;  ///< of the F/T sensor: beyond it the sample is marked overloaded
  float moment_range_Nm;
  float temperature_limit_degC;
  uint32_t period_us;
  uint32_t watchdog_cycles;
} crux_gripper_parameters;

/// Name of the first parameter that makes no sense (not finite, wrong sign, empty range), NULL when all do.
const char *crux_joint_parameters_fault(const crux_joint_parameters *parameters);
const char *crux_gripper_parameters_fault(const crux_gripper_parameters *parameters);

#endif
