#include "crux_emulated.h"

#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "cortex_internal.h"

static _Thread_local char last_error[256];

const char *crux_emulated_error(void) { return last_error; }

emulated_node *crux_emulated_open(const char *image, int limb, int node, const emulated_world *world) {
  if ((limb < 0) || (limb > 3) || (node < 1) || (node > EMULATED_LAST)) {
    (void)snprintf(last_error, sizeof(last_error), "no node %d on limb %d: nodes are 1..8, limbs 0..3", node, limb);
    return NULL;
  }
  return emulated_node_new(image, limb, node, world, last_error, sizeof(last_error));
}

void crux_emulated_close(emulated_node *node) { emulated_node_delete(node); }

void crux_emulated_power_on(emulated_node *node, double position) { emulated_node_power_on(node, position); }

const crux_outside_node *crux_emulated_port(emulated_node *node) { return &node->port; }

const char *crux_emulated_fault(const emulated_node *node) { return node->chip.core.fault; }

uint64_t crux_emulated_instructions(const emulated_node *node) { return node->chip.core.executed.instructions; }

cortex_cost crux_emulated_cost(const emulated_node *node, uint32_t exception) {
  const cortex_cost nothing = {0};
  return (exception < CORTEX_EXCEPTIONS) ? node->chip.core.cost[exception] : nothing;
}

double crux_emulated_control(emulated_node *node, double dt, double position) {
  const crux_measured measured = {.position = position};
  return node->port.control(node->port.context, dt, &measured);
}

cortex_cycles crux_emulated_cycles(uint16_t first, uint16_t second) { return cortex_cycles_of(first, second); }

void crux_emulated_measure(emulated_node *node, int on) { node->chip.core.measures = on != 0; }

static crux_frame frame_of(uint16_t id, const uint8_t *data, int length) {
  crux_frame frame = {.id = id};
  if ((length >= 0) && (length <= (int)CRUX_FRAME_CAPACITY)) {
    frame.length = (uint8_t)length;
    (void)memcpy(frame.data, data, (size_t)length);
  }
  return frame;
}

void crux_emulated_hear(emulated_node *node, uint16_t id, const uint8_t *data, int length) {
  const crux_frame frame = frame_of(id, data, length);
  node->port.hear(node->port.context, &frame);
}

void crux_emulated_flood(emulated_node *node, uint16_t id, const uint8_t *data, int length, int count) {
  const crux_frame frame = frame_of(id, data, length);
  fdcan_model_flood(&node->chip.can[0], node->chip.core.now, &frame, (count > 0) ? (uint32_t)count : 0U);
}

void crux_emulated_disturb(emulated_node *node, int on) { node->port.disturb(node->port.context, on != 0); }

void crux_emulated_break_encoder(emulated_node *node, int on) { node->encoder_broken = on != 0; }

void crux_emulated_flag_encoder(emulated_node *node) { node->rotor_encoder.error = true; }

void crux_emulated_stick_amplifier(emulated_node *node, int phase, double current_A) {
  if ((phase == 0) || (phase == 1)) {
    node->stuck_A[phase] = current_A;
  }
}

void crux_emulated_swap_phases(emulated_node *node, int on) { node->phases_swapped = on != 0; }

void crux_emulated_turn_magnets(emulated_node *node, double electrical_rad) {
  node->magnets_turned_rad = electrical_rad;
}

void crux_emulated_blank(emulated_node *node) { emulated_node_blank(node); }

void crux_emulated_break_driver(emulated_node *node, int on) { stm32g4_break(&node->chip, on != 0); }

uint32_t crux_emulated_can_register(const emulated_node *node, uint32_t offset) {
  return fdcan_model_read(&node->chip.can[0], offset);
}

void crux_emulated_cut_power(emulated_node *node, uint32_t operation, int cut) {
  crux_flash_model_power(&node->chip.flash, operation, (crux_flash_cut)cut);
}

int crux_emulated_record(emulated_node *node) {
  return flash_record_begin(&node->chip.record, &node->chip.flash) ? 1 : 0;
}

uint32_t crux_emulated_recorded(const emulated_node *node) { return node->chip.record.count; }

void crux_emulated_replay(emulated_node *node, uint32_t operation, int cut) {
  flash_record_replay(&node->chip.record, &node->chip.flash, operation, (crux_flash_cut)cut);
}

void crux_emulated_look_into(emulated_node *node, const char *program) { emulated_node_look_into(node, program); }

uint32_t crux_emulated_vectors(const emulated_node *node) { return node->chip.core.control_space[SCB_VTOR / 4U]; }
