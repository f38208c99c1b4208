/// Image of a joint node.
#include <math.h>
#include <stddef.h>

#include "board.h"
#include "drive/joint_drive.h"
#include "drive_port.h"
#include "fdcan.h"
#include "flash_port.h"
#include "joint_node.h"
#include "node_table.h"
#include "service.h"
#include "update_port.h"

static crux_joint_node node;
static crux_joint_drive drive;
static crux_service service;
static crux_joint_inputs inputs;
static crux_joint_outputs outputs;
static crux_requests requests;
static bool driven;  ///< the board is calibrated

static float middle_rad(const crux_joint_parameters *limits) {
  return 0.5F * (limits->position_min_rad + limits->position_max_rad);
}

/// Homes and starts the drive. Without a calibration there is none.
static bool start(const crux_joint_drive_parameters *parameters, const crux_joint_parameters *limits) {
  calibration mounted;
  const bool known = calibration_read(&mounted);
  if (known) {
    uint32_t motor_raw = 0U;
    uint32_t coarse_raw = 0U;
    crux_joint_drive_init(&drive, parameters, &mounted.mounting, &drive_port_timing);
    if (drive_port_read_encoders(&motor_raw, &coarse_raw)) {
      crux_encoder_step(&drive.drive.encoder, motor_raw, true);
      (void)crux_joint_drive_home(&drive, coarse_raw, middle_rad(limits));
    }
    drive_port_start(&drive.drive, &mounted);
  }
  return known;
}

static void search(void) {
  uint32_t motor_raw = 0U;
  uint32_t coarse_raw = 0U;
  if (drive_port_search(&motor_raw, &coarse_raw)) {
    crux_joint_drive_find(&drive, motor_raw, coarse_raw, middle_rad(&node.parameters));
  }
}

static void measure(void) {
  if (!driven) {
    inputs.health.cause = (uint8_t)CRUX_CAUSE_NOT_CALIBRATED;
    inputs.position_rad = NAN;
    inputs.velocity_rad_s = NAN;
  } else if (drive_port_tick()) {
    search();
    crux_joint_drive_measure(&drive, &inputs);
  } else {
    inputs.health.cause = (uint8_t)CRUX_CAUSE_SENSOR;
    inputs.position_rad = NAN;
    inputs.velocity_rad_s = NAN;
  }
  inputs.temperature_degC = drive_port_temperature_degC();
  inputs.bus_off = fdcan_recover();
  inputs.driver_fault = drive_port_driver_fault();
}

/// The node alone, from one interrupt to the next: also while its services wait for the flash. True once a tick.
static bool run_node(void) {
  crux_frame frame;
  const bool tick = board_wait_for_tick();
  while (fdcan_receive(&frame)) {
    crux_joint_node_on_frame(&node, &frame);
    update_port_keep(&requests, &frame);
  }
  if (tick) {
    measure();
    crux_joint_node_tick(&node, BOARD_TICK_S, &inputs, &outputs);
    if (driven) {
      crux_joint_drive_tick(&drive, BOARD_TICK_S, outputs.torque_Nm, inputs.temperature_degC);
    }
    board_feed_watchdog(update_port_is_kept());
  }
  crux_joint_node_publish(&node, &inputs);
  while (fdcan_can_send() && crux_link_take_frame(&node.link, &frame)) {
    fdcan_send(&frame);
  }
  return tick;
}

static void wait_for_flash(void) { (void)run_node(); }

int main(void) {
  board_init();
  const uint8_t number = board_strapped_node();
  const uint8_t limb = board_strapped_limb();
  if ((number < 1U) || (number > CRUX_CAN_NODES) || (number == CRUX_CAN_NODE_GRIPPER)) {
    return 1;  // not strapped as a joint: stay off the bus
  }
  const uint32_t index = (limb * CRUX_CAN_JOINTS) + CRUX_CAN_JOINT_OF_NODE(number);
  crux_joint_parameters parameters = node_table_joints[index];
  const crux_joint_drive_parameters *motor = &node_table_joint_drives[index];
  if ((crux_joint_parameters_fault(&parameters) != NULL) || (crux_motor_parameters_fault(&motor->motor) != NULL) ||
      (crux_gear_parameters_fault(&motor->gear) != NULL)) {
    return 1;
  }
  crux_service_init(&service, number, update_port_init((uint32_t)CRUX_KIND_JOINT), node_table_hash, &parameters,
                    flash_port_store());
  crux_joint_node_init(&node, limb, number, node_table_hash, &parameters);
  update_port_offer(&service);
  crux_service_attach(&service, &node.parameters);
  driven = start(motor, &parameters);
  fdcan_init((uint16_t)CRUX_CAN_ID_SYNC, (uint16_t)CRUX_CAN_ID_JOINT_COMMAND(number),
             (uint16_t)CRUX_CAN_ID_JOINT_REQUEST(number), (uint16_t)CRUX_CAN_ID_BROADCAST,
             (uint16_t)CRUX_CAN_ID_HOST_HEARTBEAT);
  requests.id = (uint16_t)CRUX_CAN_ID_JOINT_REQUEST(number);
  measure();
  flash_port_while_busy(wait_for_flash);
  for (;;) {
    const bool tick = run_node();
    update_port_serve(&service, &requests, tick, &node.state, &node.guard);
  }
}
