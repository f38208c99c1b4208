/// Image of a gripper node.
#include "board.h"
#include "fdcan.h"
#include "gripper_node.h"
#include "node_table.h"

/// Of the speed taken from the potentiometer [s].
#define SPEED_TIME_CONSTANT_S 0.02F

static crux_gripper_node node;

/// The potentiometer's travel is the fingers' travel.
static float opening(const crux_gripper_parameters *parameters) {
  return parameters->opening_min_m +
         (board_potentiometer_share() * (parameters->opening_max_m - parameters->opening_min_m));
}

static void measure(const crux_gripper_parameters *parameters, crux_gripper_inputs *inputs) {
  const float opening_m = opening(parameters);
  const float speed_m_s = (opening_m - inputs->opening_m) / BOARD_TICK_S;
  const float share = BOARD_TICK_S / (SPEED_TIME_CONSTANT_S + BOARD_TICK_S);
  inputs->speed_m_s += share * (speed_m_s - inputs->speed_m_s);
  inputs->opening_m = opening_m;
  inputs->temperature_degC = board_temperature_degC();
  inputs->bus_off = fdcan_recover();
}

int main(void) {
  board_init();
  const uint8_t limb = board_strapped_limb();
  const crux_gripper_parameters *parameters = &node_table_grippers[limb];
  if (crux_gripper_parameters_fault(parameters) != NULL) {
    return 1;
  }
  crux_gripper_node_init(&node, limb, node_table_hash, parameters);
  fdcan_init((uint16_t)CRUX_CAN_ID_SYNC, (uint16_t)CRUX_CAN_ID_GRIPPER_COMMAND);
  // No force/torque sensor is read yet: its samples say "not ready".
  crux_gripper_inputs inputs = {.opening_m = opening(parameters), .wrench_valid = false};
  crux_gripper_outputs outputs = {0};
  for (;;) {
    crux_frame frame;
    const bool tick = board_wait_for_tick();
    while (fdcan_receive(&frame)) {
      crux_gripper_node_on_frame(&node, &frame);
    }
    if (tick) {
      measure(parameters, &inputs);
      crux_gripper_node_tick(&node, BOARD_TICK_S, &inputs, &outputs);
      board_drive(outputs.force_N / parameters->force_limit_N);
      inputs.force_N = outputs.force_N;  // no current sensor read yet: the demand stands for the force
    }
    crux_gripper_node_publish(&node, &inputs);
    while (fdcan_can_send() && crux_link_take_frame(&node.link, &frame)) {
      fdcan_send(&frame);
    }
  }
}
