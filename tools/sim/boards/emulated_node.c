#include "emulated_node.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "elf_image.h"
#include "gripper_node.h"
#include "joint_node.h"

#define FLASH_START 0x08000000U
#define RAM_START 0x20000000U
#define CORE_HZ 170000000U
#define CRYSTAL_HZ 24000000U
#define BOOT_S 0.02  ///< between power-on and the first frame
#define TWO_PI 6.283185307179586
#define TURN 16384U
#define ROOM_DEG_C 25.0
#define WRENCH_PERIOD (CORE_HZ / 1000U)

// Pins of port A and converter channels.
#define ROTOR_SELECT 4U
#define COARSE_SELECT 15U
#define SUPPLY_CHANNEL 3U
#define THERMISTOR_CHANNEL 4U

// Calibration page, the last of the flash.
#define CALIBRATION_OFFSET 0x7F800U
#define CALIBRATION_BYTES 0x800U
#define CALIBRATION_MAGIC 0x43525543U

static double position_at(const emulated_node *node, uint64_t time) {
  const double length = (double)(node->window_end - node->window_start);
  const double past = (double)(time - node->window_start);
  const double share = (length > 0.0) ? fmin(fmax(past / length, 0.0), 1.0) : 1.0;
  return node->from + (share * (node->to - node->from));
}

static double turned(const emulated_node *node, uint64_t time, double turns_per_unit) {
  return (position_at(node, time) - node->world.zero_position) * turns_per_unit;
}

/// Of the magnets' axis; not wrapped, so that differences are speeds.
static double electrical_rad(const emulated_node *node, uint64_t time) {
  const emulated_mounting *mounting = &node->mounting;
  const double mounted = ((double)mounting->rotor_zero_counts - (double)mounting->electrical_offset_counts) / TURN;
  return (TWO_PI * node->world.pole_pairs * (turned(node, time, node->world.rotor_turns_per_unit) + mounted)) +
         node->magnets_turned_rad;
}

/// What the amplifier of phase 0 (a) or 1 (b) measures.
static double amplified_A(const emulated_node *node, unsigned phase) {
  const int wire = (node->phases_swapped && (phase == 1U)) ? 2 : (int)phase;
  return isnan(node->stuck_A[phase]) ? motor_phase_A(&node->motor, wire) : node->stuck_A[phase];
}

static uint32_t analogue(void *context, unsigned converter, unsigned channel) {
  const emulated_node *node = context;
  const unsigned phase = converter - 1U;
  switch (channel) {
    case SUPPLY_CHANNEL:
      return reading_of_supply(node->world.supply_V);
    case THERMISTOR_CHANNEL:
      return reading_of_temperature(node->temperature_degC);
    default: {
      // The shunts lie under the lower switches.
      const bool flows = stm32g4_lower_conducts(&node->chip, phase);
      return reading_of_current(flows ? amplified_A(node, phase) : 0.0,
                                (double)node->mounting.phase_zero_counts[phase]);
    }
  }
}

/// The bridge has made `duty` since the last period began.
static void pwm_period(void *context, uint64_t time, const double duty[3]) {
  emulated_node *node = context;
  const double angle_rad = electrical_rad(node, time);
  const double passed = (double)(time - node->stepped_at);
  if (passed > 0.0) {
    const double wired[3] = {duty[0], duty[node->phases_swapped ? 2 : 1], duty[node->phases_swapped ? 1 : 2]};
    const motor_vector voltage_V = motor_voltage_V(&node->motor.parameters, wired);
    node->torque_time += passed * motor_step(&node->motor, voltage_V, passed / CORE_HZ, node->angle_rad, angle_rad);
  }
  node->angle_rad = angle_rad;
  node->stepped_at = time;
}

static void pins(void *context, uint32_t before, uint32_t after) {
  emulated_node *node = context;
  const uint32_t rising = after & ~before;
  const uint64_t now = node->chip.core.now;
  if (((rising >> ROTOR_SELECT) & 1U) != 0U) {
    const double turns = turned(node, now, node->world.rotor_turns_per_unit);
    magnetic_encoder_latch(&node->rotor_encoder, encoder_counts(turns, node->mounting.rotor_zero_counts));
  }
  if (((rising >> COARSE_SELECT) & 1U) != 0U) {
    const double turns = turned(node, now, node->world.coarse_turns_per_unit);
    magnetic_encoder_latch(&node->coarse_encoder, encoder_counts(turns, node->mounting.coarse_zero_counts));
  }
}

static uint16_t transfer(void *context, uint16_t out) {
  emulated_node *node = context;
  uint16_t answer = 0xFFFFU;  // nobody pulls the line
  if (!stm32g4_pin(&node->chip, ROTOR_SELECT) && !node->encoder_broken) {
    answer &= magnetic_encoder_exchange(&node->rotor_encoder, out);
  }
  if (!stm32g4_pin(&node->chip, COARSE_SELECT)) {
    answer &= magnetic_encoder_exchange(&node->coarse_encoder, out);
  }
  return answer;
}

static uint64_t cycles(double seconds) { return (uint64_t)llround(seconds * (double)CORE_HZ); }

static void run(emulated_node *node, double seconds) {
  node->window_start = node->chip.core.now;
  node->window_end = node->window_start + cycles(seconds);
  cortex_run_until(&node->chip.core, node->window_end);
}

static void power_on(emulated_node *node) {
  node->powered = true;
  node->wrench_asked = false;
  node->stepped_at = node->chip.core.now;
  node->angle_rad = electrical_rad(node, node->stepped_at);
  node->motor.current_A = (motor_vector){0.0, 0.0};
  stm32g4_power_on(&node->chip);
}

/// Until the timer runs nothing drives the gates: the bridge is open, and what flowed has gone through the diodes.
static void pwm_start(void *context, uint64_t time) {
  emulated_node *node = context;
  node->stepped_at = time;
  node->angle_rad = electrical_rad(node, time);
  node->motor.current_A = (motor_vector){0.0, 0.0};
}

/// The force/torque sensor's samples of the window to come.
static void measure_wrench(emulated_node *node, const double wrench[6], uint64_t window) {
  fdcan_model *can = &node->chip.can[1];
  crux_frame frames[2];
  while (fdcan_model_fetch(can, &frames[0])) {
    node->wrench_asked = node->wrench_asked || wrench_sensor_is_asked(&frames[0]);
  }
  const uint64_t now = node->chip.core.now;
  wrench_sensor_say(wrench, frames);
  for (node->wrench_at = (node->wrench_at < now) ? now : node->wrench_at; node->wrench_at < now + window;
       node->wrench_at += WRENCH_PERIOD) {
    for (int i = 0; node->wrench_asked && (i < 2); i++) {
      fdcan_model_hear(can, node->wrench_at, &frames[i]);
    }
  }
}

/// What was heard since the last window begins to arrive.
static void deliver(emulated_node *node) {
  for (uint32_t i = 0U; i < node->heard_count; i++) {
    fdcan_model_hear(&node->chip.can[0], node->chip.core.now, &node->heard[i]);
  }
  node->heard_count = 0U;
  stm32g4_settle(&node->chip);
}

/// Lets periods pass with the shaft at rest until the last frame on its way leaves time for an answer in the next one.
/// A host that repeats its first Sync while a bench starts sends more than a period's frames.
static void catch_up(emulated_node *node, double dt) {
  const uint64_t latest = (cycles(dt) * 3U) / 4U;
  node->from = node->to;
  while (node->chip.can[0].idle_at > node->chip.core.now + latest) {
    run(node, dt);
  }
}

void emulated_node_power_on(emulated_node *node, double position) {
  node->from = position;
  node->to = position;
  power_on(node);
  run(node, BOOT_S);
}

static double control(void *context, double dt, const crux_measured *measured) {
  emulated_node *node = context;
  if (!node->powered) {
    emulated_node_power_on(node, measured->position);
  }
  deliver(node);
  catch_up(node, dt);
  node->to = measured->position;
  node->dt = dt;
  node->controlled = true;
  if (node->node == EMULATED_GRIPPER) {
    measure_wrench(node, measured->wrench, cycles(dt));
  }
  stm32g4_settle(&node->chip);
  node->torque_time = 0.0;
  run(node, dt);
  return node->world.effort_per_Nm * node->torque_time / (double)cycles(dt);
}

static void hear(void *context, const crux_frame *frame) {
  emulated_node *node = context;
  if (node->heard_count < EMULATED_INBOX) {
    node->heard[node->heard_count] = *frame;
    node->heard_count++;
  }
}

static bool fetch(void *context, crux_frame *frame) {
  emulated_node *node = context;
  if (!node->controlled && (node->heard_count > 0U) && node->powered && (node->dt > 0.0)) {
    // Answers are wanted though no time has passed in the bench: the host repeats a Sync. Here it passes.
    deliver(node);
    node->from = node->to;
    run(node, node->dt);
  }
  const bool found = fdcan_model_fetch(&node->chip.can[0], frame);
  node->controlled = node->controlled && found;
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

static void disturb(void *context, bool on) {
  emulated_node *node = context;
  node->chip.can[0].disturbed = on;
}

static size_t node_bytes(const emulated_node *node) {
  return (node->node == EMULATED_GRIPPER) ? sizeof(crux_gripper_node) : sizeof(crux_joint_node);
}

/// Looks into the image's memory: a node that is off the bus says nothing, and what it does counts all the same.
static void state(void *context, uint8_t *state_now, uint8_t *faults) {
  const emulated_node *node = context;
  const bool gripper = node->node == EMULATED_GRIPPER;
  *state_now = (uint8_t)CRUX_STATE_BOOT;
  *faults = 0U;
  if (node->object != NULL) {
    const uint8_t found = node->object[gripper ? offsetof(crux_gripper_node, state) : offsetof(crux_joint_node, state)];
    const bool runs = found <= (uint8_t)CRUX_STATE_FAULT;  // the memory is rubbish after a reset
    *state_now = runs ? found : (uint8_t)CRUX_STATE_BOOT;
    *faults =
        runs ? node->object[gripper ? offsetof(crux_gripper_node, link.faults) : offsetof(crux_joint_node, link.faults)]
             : 0U;
  }
}

/// The firmware's node in the chip's memory: of fixed size and aligned the same here and there.
void emulated_node_look_into(emulated_node *node, const char *image) {
  const uint32_t address = elf_image_object(image, "node", (uint32_t)node_bytes(node));
  if ((address >= RAM_START) && (address - RAM_START <= CORTEX_RAM_BYTES - node_bytes(node))) {
    node->object = node->chip.core.ram + (address - RAM_START);
  }
}

/// No board is mounted like another: zeros that look random and are the same in every run.
static emulated_mounting mount(int limb, int number) {
  const uint32_t seed = (number <= EMULATED_GRIPPER) ? (uint32_t)((limb * EMULATED_GRIPPER) + number)
                                                     : (uint32_t)(((limb + 1) * number) + (4 * EMULATED_GRIPPER));
  return (emulated_mounting){.electrical_offset_counts = (seed * 7919U) % TURN,
                             .rotor_zero_counts = (seed * 6101U) % TURN,
                             .coarse_zero_counts = (seed * 3571U) % TURN,
                             .phase_zero_counts = {2040U + (seed % 16U), 2056U - (seed % 13U)}};
}

static void write_calibration(emulated_node *node) {
  const emulated_mounting *mounting = &node->mounting;
  uint32_t page[7] = {CALIBRATION_MAGIC,
                      mounting->electrical_offset_counts,
                      mounting->rotor_zero_counts,
                      mounting->coarse_zero_counts,
                      mounting->phase_zero_counts[0],
                      mounting->phase_zero_counts[1],
                      0U};
  uint32_t sum = 0U;
  for (int i = 0; i < 6; i++) {
    sum += page[i];
  }
  page[6] = ~sum;
  (void)memcpy(node->chip.core.flash + CALIBRATION_OFFSET, page, sizeof(page));
}

void emulated_node_blank(emulated_node *node) {
  (void)memset(node->chip.core.flash + CALIBRATION_OFFSET, 0xFF, CALIBRATION_BYTES);
}

emulated_node *emulated_node_new(const char *image, int limb, int number, const emulated_world *world, char *error,
                                 size_t error_bytes) {
  emulated_node *node = calloc(1U, sizeof(*node));
  if (node == NULL) {
    (void)snprintf(error, error_bytes, "out of memory");
    return NULL;
  }
  const stm32g4_board board = {
      .context = node,
      .crystal_hz = CRYSTAL_HZ,
      .straps = ((uint32_t)limb << 3U) | ((uint32_t)number & 7U) | (((uint32_t)number & 8U) << 2U),
      .analogue = analogue,
      .pwm_start = pwm_start,
      .pwm_period = pwm_period,
      .pins = pins,
      .transfer = transfer};
  node->port = (crux_outside_node){.context = node,
                                   .hear = hear,
                                   .control = control,
                                   .fetch = fetch,
                                   .restart = restart,
                                   .set_temperature = set_temperature,
                                   .disturb = disturb,
                                   .state = state};
  node->world = *world;
  node->mounting = mount(limb, number);
  node->motor.parameters = (motor_parameters){.pole_pairs = world->pole_pairs,
                                              .resistance_ohm = world->resistance_ohm,
                                              .inductance_H = world->inductance_H,
                                              .flux_Wb = world->flux_Wb,
                                              .supply_V = world->supply_V};
  node->limb = limb;
  node->node = number;
  node->stuck_A[0] = NAN;
  node->stuck_A[1] = NAN;
  node->temperature_degC = ROOM_DEG_C;
  if (!stm32g4_open(&node->chip, &board, (uint32_t)world->bit_rate, (uint32_t)world->data_bit_rate)) {
    (void)snprintf(error, error_bytes, "%s", node->chip.core.fault);
    free(node);
    return NULL;
  }
  if (!elf_image_load(image, FLASH_START, node->chip.core.flash, CORTEX_FLASH_BYTES, error, error_bytes)) {
    emulated_node_delete(node);
    return NULL;
  }
  emulated_node_look_into(node, image);
  write_calibration(node);
  return node;
}

void emulated_node_delete(emulated_node *node) {
  if (node != NULL) {
    stm32g4_close(&node->chip);
    free(node);
  }
}
