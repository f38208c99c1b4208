/// Sensors of a node board: two magnetic encoders on the SPI, phase currents, supply and winding temperature, and a
/// gripper's force/torque sensor (Robotous RFT series) on a CAN bus of its own.
#ifndef CRUX_EMULATED_BOARD_SENSORS_H
#define CRUX_EMULATED_BOARD_SENSORS_H

#include <stdbool.h>
#include <stdint.h>

#include "frame.h"

/// AS5047P: takes its angle when the select goes up, and answers a command in the frame after it.
typedef struct magnetic_encoder {
  bool error;        ///< of a command: every answer says so until the register of errors has been read
  uint32_t latched;  ///< 14 bits
  uint16_t command;  ///< of the last frame
} magnetic_encoder;

/// The select goes up over `counts` of a turn of 16384.
void magnetic_encoder_latch(magnetic_encoder *encoder, uint32_t counts);

/// One frame while selected.
uint16_t magnetic_encoder_exchange(magnetic_encoder *encoder, uint16_t command);

/// Counts 0..16383 of so many turns, from a zero.
uint32_t encoder_counts(double turns, uint32_t zero_counts);

// Readings of the 12-bit converter.
uint32_t reading_of_current(double current_A, double zero_counts);
uint32_t reading_of_supply(double supply_V);
uint32_t reading_of_temperature(double temperature_degC);

/// Whether the frame asks the force/torque sensor for a stream of samples.
bool wrench_sensor_is_asked(const crux_frame *frame);

/// The two frames of a sample: forces [N], moments [Nm].
void wrench_sensor_say(const double wrench[6], crux_frame frames[2]);

#endif
