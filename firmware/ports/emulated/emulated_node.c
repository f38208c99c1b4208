#include "emulated_node.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "codec.h"
#include "elf_image.h"

#define FLASH_START 0x08000000U
#define CORE_HZ 170000000U
#define CRYSTAL_HZ 24000000U
#define BOOT_S 0.005  ///< between power-on and the first frame
#define TWO_PI 6.283185307179586
#define COUNTS_PER_TURN 16384.0
#define FULL_SCALE 4095.0
#define DIRECTION_PIN 9U
#define POTENTIOMETER 4U
#define THERMOMETER 16U
#define ROOM_DEG_C 25.0

// Factory calibration of the temperature sensor: readings at 30 and 110 degC and 3.0 V; the board has 3.3 V.
#define CALIBRATION_LOW 1035.0
#define CALIBRATION_HIGH 1376.0
#define CALIBRATION_V 3.0
#define REFERENCE_V 3.3

static double position_now(const emulated_node *node) {
  const uint64_t now = node->chip.core.now;
  const double length = (double)(node->window_end - node->window_start);
  const double past = (double)(now - node->window_start);
  const double share = (length > 0.0) ? fmin(past / length, 1.0) : 1.0;
  return node->from + (share * (node->to - node->from));
}

static uint32_t quadrature(void *context) {
  const emulated_node *node = context;
  return (uint32_t)(int32_t)lrint(floor(position_now(node) * COUNTS_PER_TURN / TWO_PI));
}

static uint32_t clip_reading(double reading) { return (uint32_t)lrint(fmin(fmax(reading, 0.0), FULL_SCALE)); }

static uint32_t analogue(void *context, unsigned converter, unsigned channel) {
  const emulated_node *node = context;
  (void)converter;
  if (channel == POTENTIOMETER) {
    const emulated_world *world = &node->world;
    return clip_reading(FULL_SCALE * (position_now(node) - world->opening_min_m) /
                        (world->opening_max_m - world->opening_min_m));
  }
  if (channel == THERMOMETER) {
    const double slope = (CALIBRATION_HIGH - CALIBRATION_LOW) / (110.0 - 30.0);
    return clip_reading((CALIBRATION_LOW + (slope * (node->temperature_degC - 30.0))) * CALIBRATION_V / REFERENCE_V);
  }
  return 0U;
}

static void pwm_period(void *context, const uint32_t compare[3]) {
  (void)context;
  (void)compare;
}

static void pins(void *context, uint32_t before, uint32_t after) {
  (void)context;
  (void)before;
  (void)after;
}

static uint16_t transfer(void *context, uint16_t out) {
  (void)context;
  (void)out;
  return 0xFFFFU;
}

static uint64_t cycles(double seconds) { return (uint64_t)llround(seconds * (double)CORE_HZ); }

static void run(emulated_node *node, double seconds) {
  node->window_start = node->chip.core.now;
  node->window_end = node->window_start + cycles(seconds);
  cortex_run_until(&node->chip.core, node->window_end);
}

static void power_on(emulated_node *node) {
  node->powered = true;
  stm32g4_power_on(&node->chip);
}

static double effort(const emulated_node *node) {
  const double full = (node->node == EMULATED_GRIPPER) ? node->world.force_limit_N : node->world.torque_limit_Nm;
  const double share = fmin(stm32g4_duty(&node->chip, 0U), 1.0);
  return stm32g4_pin(&node->chip, DIRECTION_PIN) ? -full * share : full * share;
}

static double control(void *context, double dt, const crux_measured *measured) {
  emulated_node *node = context;
  node->from = node->to;
  node->to = measured->position;
  if (!node->powered) {
    node->from = node->to;
    power_on(node);
    run(node, BOOT_S);
  }
  for (uint32_t i = 0U; i < node->heard_count; i++) {
    fdcan_model_hear(&node->chip.can[0], node->chip.core.now, &node->heard[i]);
  }
  node->heard_count = 0U;
  stm32g4_settle(&node->chip);
  run(node, dt);
  return effort(node);
}

static void hear(void *context, const crux_frame *frame) {
  emulated_node *node = context;
  if (node->heard_count < EMULATED_INBOX) {
    node->heard[node->heard_count] = *frame;
    node->heard_count++;
  }
}

static void look_at(emulated_node *node, const crux_frame *frame) {
  if (frame->id == (uint16_t)CRUX_CAN_ID_JOINT_STATUS(node->node)) {
    if (node->node == EMULATED_GRIPPER) {
      struct crux_can_gripper_status_t status;
      if (crux_can_gripper_status_unpack(&status, frame->data, frame->length) == 0) {
        node->state = status.state;
        node->faults = status.faults;
      }
    } else {
      struct crux_can_joint_status_t status;
      if (crux_can_joint_status_unpack(&status, frame->data, frame->length) == 0) {
        node->state = status.state;
        node->faults = status.faults;
      }
    }
  }
}

static bool fetch(void *context, crux_frame *frame) {
  emulated_node *node = context;
  const bool found = fdcan_model_fetch(&node->chip.can[0], frame);
  if (found) {
    look_at(node, frame);
  }
  return found;
}

static void restart(void *context) {
  emulated_node *node = context;
  if (node->powered) {
    power_on(node);
  }
}

static void set_temperature(void *context, double temperature_degC) {
  emulated_node *node = context;
  node->temperature_degC = temperature_degC;
}

static void state(void *context, uint8_t *last_state, uint8_t *last_faults) {
  const emulated_node *node = context;
  *last_state = node->state;
  *last_faults = node->faults;
}

emulated_node *emulated_node_new(const char *image, int limb, int number, const emulated_world *world, char *error,
                                 size_t error_bytes) {
  const uint16_t calibration[2] = {(uint16_t)CALIBRATION_LOW, (uint16_t)CALIBRATION_HIGH};
  emulated_node *node = calloc(1U, sizeof(*node));
  if (node == NULL) {
    (void)snprintf(error, error_bytes, "out of memory");
    return NULL;
  }
  const stm32g4_board board = {.context = node,
                               .crystal_hz = CRYSTAL_HZ,
                               .straps = ((uint32_t)limb << 3U) | (uint32_t)number,
                               .analogue = analogue,
                               .quadrature = quadrature,
                               .pwm_period = pwm_period,
                               .pins = pins,
                               .transfer = transfer};
  node->port = (crux_outside_node){.context = node,
                                   .hear = hear,
                                   .control = control,
                                   .fetch = fetch,
                                   .restart = restart,
                                   .set_temperature = set_temperature,
                                   .state = state};
  node->world = *world;
  node->limb = limb;
  node->node = number;
  node->temperature_degC = ROOM_DEG_C;
  if (!stm32g4_open(&node->chip, &board, (uint32_t)world->bit_rate, (uint32_t)world->data_bit_rate)) {
    (void)snprintf(error, error_bytes, "%s", node->chip.core.fault);
    free(node);
    return NULL;
  }
  (void)memcpy(node->chip.core.system + 0x5A8U, &calibration[0], sizeof(calibration[0]));
  (void)memcpy(node->chip.core.system + 0x5CAU, &calibration[1], sizeof(calibration[1]));
  if (!elf_image_load(image, FLASH_START, node->chip.core.flash, CORTEX_FLASH_BYTES, error, error_bytes)) {
    emulated_node_delete(node);
    return NULL;
  }
  fdcan_model_reset(&node->chip.can[0], node->chip.bit_rate, node->chip.data_bit_rate);
  return node;
}

void emulated_node_delete(emulated_node *node) {
  if (node != NULL) {
    stm32g4_close(&node->chip);
    free(node);
  }
}
