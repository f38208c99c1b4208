/// Image of a joint node.
#include "board.h"
#include "fdcan.h"
#include "joint_node.h"
#include "node_table.h"

/// Of the velocity taken from encoder counts [s]: a count a tick is far too coarse by itself.
#define VELOCITY_TIME_CONSTANT_S 0.005F

static crux_joint_node node;

static void measure(crux_joint_inputs *inputs) {
  const float position_rad = board_encoder_position_rad();
  const float velocity_rad_s = (position_rad - inputs->position_rad) / BOARD_TICK_S;
  const float share = BOARD_TICK_S / (VELOCITY_TIME_CONSTANT_S + BOARD_TICK_S);
  inputs->velocity_rad_s += share * (velocity_rad_s - inputs->velocity_rad_s);
  inputs->position_rad = position_rad;
  inputs->temperature_degC = board_temperature_degC();
  inputs->bus_off = fdcan_recover();
}

int main(void) {
  board_init();
  const uint8_t number = board_strapped_node();
  const uint8_t limb = board_strapped_limb();
  if ((number < 1U) || (number > CRUX_CAN_JOINTS)) {
    return 1;  // not strapped as a joint: stay off the bus
  }
  const crux_joint_parameters *parameters = &node_table_joints[(limb * CRUX_CAN_JOINTS) + number - 1U];
  if (crux_joint_parameters_fault(parameters) != NULL) {
    return 1;
  }
  crux_joint_node_init(&node, limb, number, node_table_hash, parameters);
  fdcan_init((uint16_t)CRUX_CAN_ID_SYNC, (uint16_t)CRUX_CAN_ID_JOINT_COMMAND(number));
  crux_joint_inputs inputs = {.position_rad = board_encoder_position_rad()};
  crux_joint_outputs outputs = {0};
  for (;;) {
    crux_frame frame;
    const bool tick = board_wait_for_tick();
    while (fdcan_receive(&frame)) {
      crux_joint_node_on_frame(&node, &frame);
    }
    if (tick) {
      measure(&inputs);
      crux_joint_node_tick(&node, BOARD_TICK_S, &inputs, &outputs);
      board_drive(outputs.torque_Nm / parameters->torque_limit_Nm);
      inputs.torque_Nm = outputs.torque_Nm;  // no current sensor read yet: the demand stands for the torque
    }
    crux_joint_node_publish(&node, &inputs);
    while (fdcan_can_send() && crux_link_take_frame(&node.link, &frame)) {
      fdcan_send(&frame);
    }
  }
}
