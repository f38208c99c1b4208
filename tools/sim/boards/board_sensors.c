#include "board_sensors.h"

#include <math.h>
#include <string.h>

#define TURN 16384.0
#define READ_ANGLE 0x3FFFU
#define READ_ERRORS 0x0001U
#define ERROR_FLAG 0x4000U
#define COUNTS 4096.0
#define REFERENCE_V 3.3
#define AMPLIFIER_V_A 0.1
#define SUPPLY_DIVIDER 11.0
// 10 kOhm at 25 degC to ground, 10 kOhm to the reference.
#define THERMISTOR_B_K 3435.0
#define NOMINAL_K 298.15
#define CELSIUS_K 273.15

#define WRENCH_ASK_ID 0x64U
#define WRENCH_STREAM 0x0BU
#define WRENCH_COUNTS_N 50.0
#define WRENCH_COUNTS_NM 2000.0

void magnetic_encoder_latch(magnetic_encoder *encoder, uint32_t counts) { encoder->latched = counts; }

uint16_t magnetic_encoder_exchange(magnetic_encoder *encoder, uint16_t command) {
  const uint32_t address = encoder->command & READ_ANGLE;
  uint32_t content = (address == READ_ANGLE) ? encoder->latched : 0U;
  if (address == READ_ERRORS) {
    content = encoder->error ? 1U : 0U;
    encoder->error = false;
  }
  content |= encoder->error ? ERROR_FLAG : 0U;
  encoder->command = command;
  return (uint16_t)(content | (((uint32_t)__builtin_parity(content)) << 15U));
}

uint32_t encoder_counts(double turns, uint32_t zero_counts) {
  return ((uint32_t)((turns - floor(turns)) * TURN) + zero_counts) % (uint32_t)TURN;
}

static uint32_t reading(double counts) { return (uint32_t)lrint(fmin(fmax(counts, 0.0), COUNTS - 1.0)); }

uint32_t reading_of_current(double current_A, double zero_counts) {
  return reading(zero_counts + (current_A * AMPLIFIER_V_A * COUNTS / REFERENCE_V));
}

uint32_t reading_of_supply(double supply_V) { return reading(supply_V / SUPPLY_DIVIDER * COUNTS / REFERENCE_V); }

uint32_t reading_of_temperature(double temperature_degC) {
  const double share_to_ground = exp(THERMISTOR_B_K * ((1.0 / (temperature_degC + CELSIUS_K)) - (1.0 / NOMINAL_K)));
  return reading(COUNTS * share_to_ground / (1.0 + share_to_ground));
}

bool wrench_sensor_is_asked(const crux_frame *frame) {
  return (frame->id == WRENCH_ASK_ID) && (frame->length > 0U) && (frame->data[0] == WRENCH_STREAM);
}

void wrench_sensor_say(const double wrench[6], crux_frame frames[2]) {
  uint8_t bytes[16] = {WRENCH_STREAM};
  for (int i = 0; i < 6; i++) {
    const double counts = wrench[i] * ((i < 3) ? WRENCH_COUNTS_N : WRENCH_COUNTS_NM);
    const uint32_t value = (uint32_t)(int32_t)lrint(fmin(fmax(counts, -32768.0), 32767.0));
    bytes[1 + (2 * i)] = (uint8_t)(value >> 8U);
    bytes[2 + (2 * i)] = (uint8_t)value;
  }
  for (int i = 0; i < 2; i++) {
    frames[i] = (crux_frame){.id = (uint16_t)(1 + i), .length = 8U};
    (void)memcpy(frames[i].data, &bytes[8 * i], 8U);
  }
}
