#include "wrench_sensor.h"

#include <string.h>

#define HALF 8U
#define SAMPLE 16U
#define OVERLOAD 13U  ///< byte of the sample
#define START 0x0BU   ///< command, and first byte of every sample
#define COUNTS_PER_N 50.0F
#define COUNTS_PER_NM 2000.0F

/// The sensor's slowest useful rate is its factory setting, 200 samples a second.
#define MAX_AGE_US 12000U
#define ASK_AGAIN_US 100000U

void crux_wrench_sensor_init(crux_wrench_sensor *sensor) {
  *sensor = (crux_wrench_sensor){.age_us = MAX_AGE_US + 1U, .restart_us = ASK_AGAIN_US};
}

static float component(const uint8_t *bytes) {
  const uint32_t word = ((uint32_t)bytes[0] << 8) | bytes[1];
  const int32_t value = (word < 0x8000U) ? (int32_t)word : ((int32_t)word - 0x10000);
  return (float)value;
}

static void take(crux_wrench_sensor *sensor, const uint8_t *second) {
  uint8_t sample[SAMPLE];
  (void)memcpy(sample, sensor->first, HALF);
  (void)memcpy(&sample[HALF], second, HALF);
  for (uint32_t i = 0U; i < 6U; i++) {
    sensor->wrench[i] = component(&sample[1U + (2U * i)]) / ((i < 3U) ? COUNTS_PER_N : COUNTS_PER_NM);
  }
  sensor->overloaded = sample[OVERLOAD] != 0U;
  sensor->age_us = 0U;
}

void crux_wrench_sensor_on_frame(crux_wrench_sensor *sensor, const crux_frame *frame) {
  const bool whole = frame->length == HALF;
  if (whole && (frame->id == CRUX_WRENCH_SENSOR_FIRST_ID)) {
    sensor->first_waits = frame->data[0] == START;
    (void)memcpy(sensor->first, frame->data, HALF);
  } else if (whole && (frame->id == CRUX_WRENCH_SENSOR_SECOND_ID)) {
    if (sensor->first_waits) {
      take(sensor, frame->data);
    }
    sensor->first_waits = false;
  } else {
    // nothing of the sensor's
  }
}

bool crux_wrench_sensor_tick(crux_wrench_sensor *sensor, uint32_t dt_us, crux_frame *frame) {
  sensor->age_us += (sensor->age_us <= MAX_AGE_US) ? dt_us : 0U;
  sensor->restart_us += (sensor->restart_us < ASK_AGAIN_US) ? dt_us : 0U;
  const bool ask = !crux_wrench_sensor_valid(sensor) && (sensor->restart_us >= ASK_AGAIN_US);
  if (ask) {
    *frame = (crux_frame){.id = CRUX_WRENCH_SENSOR_COMMAND_ID, .length = HALF, .data = {START}};
    sensor->restart_us = 0U;
  }
  return ask;
}

bool crux_wrench_sensor_valid(const crux_wrench_sensor *sensor) { return sensor->age_us <= MAX_AGE_US; }
