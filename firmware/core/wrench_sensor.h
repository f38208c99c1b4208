/// Six-axis force/torque sensor of the Robotous RFT series on its own CAN bus (classic, 1 Mbit/s, factory identifiers).
///
/// A sample is 16 bytes in two frames: 0x0B, Fx, Fy, Fz, Tx, Ty, Tz as big-endian int16 in 1/50 N and 1/2000 Nm,
/// overload flags, two bytes unused. The bus has its own checksum and acknowledge; what is checked here is that the two
/// halves belong together and that samples keep coming.
#ifndef CRUX_FIRMWARE_WRENCH_SENSOR_H
#define CRUX_FIRMWARE_WRENCH_SENSOR_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

#define CRUX_WRENCH_SENSOR_COMMAND_ID 0x64U
#define CRUX_WRENCH_SENSOR_FIRST_ID 0x01U
#define CRUX_WRENCH_SENSOR_SECOND_ID 0x02U

typedef struct crux_wrench_sensor {
  uint8_t first[8];
  bool first_waits;  ///< for its second half
  bool overloaded;
  uint32_t age_us;      ///< of the sample, saturated
  uint32_t restart_us;  ///< since the sensor was asked for samples
  float wrench[6];      ///< fx fy fz [N] mx my mz [Nm]
} crux_wrench_sensor;

/// Starts without a sample.
void crux_wrench_sensor_init(crux_wrench_sensor *sensor);

/// Takes a frame from the sensor's bus.
void crux_wrench_sensor_on_frame(crux_wrench_sensor *sensor, const crux_frame *frame);

/// Time passes. True, with the frame to send, when the sensor must be asked (again) for its samples.
bool crux_wrench_sensor_tick(crux_wrench_sensor *sensor, uint32_t dt_us, crux_frame *frame);

/// Whether the sample is young enough to be used.
bool crux_wrench_sensor_valid(const crux_wrench_sensor *sensor);

#endif
