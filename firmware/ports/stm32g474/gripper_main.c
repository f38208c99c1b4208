/// Image of a gripper node.
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "board.h"
#include "drive/gripper_drive.h"
#include "drive_port.h"
#include "fdcan.h"
#include "flash_port.h"
#include "gripper_node.h"
#include "node_table.h"
#include "service.h"
#include "update_port.h"
#include "wrench_sensor.h"

static crux_gripper_node node;
static crux_gripper_drive drive;
static crux_service service;
static crux_gripper_inputs inputs;
static crux_gripper_outputs outputs;
static crux_requests requests;
static bool driven;  ///< the board is calibrated
static crux_wrench_sensor sensor;

/// Homes and starts the drive. Without a calibration there is none.
static bool start(const crux_gripper_drive_parameters *parameters, const crux_gripper_parameters *limits) {
  calibration mounted;
  const bool known = calibration_read(&mounted);
  if (known) {
    uint32_t motor_raw = 0U;
    uint32_t coarse_raw = 0U;
    crux_gripper_drive_init(&drive, parameters, limits, &mounted.mounting, &drive_port_timing);
    if (drive_port_read_encoders(&motor_raw, &coarse_raw)) {
      crux_encoder_step(&drive.drive.encoder, motor_raw, true);
      (void)crux_gripper_drive_home(&drive, coarse_raw);
    }
    drive_port_start(&drive.drive, &mounted);
  }
  return known;
}

static void search(void) {
  uint32_t motor_raw = 0U;
  uint32_t coarse_raw = 0U;
  if (drive_port_search(&motor_raw, &coarse_raw)) {
    crux_gripper_drive_find(&drive, motor_raw, coarse_raw);
  }
}

static void measure(void) {
  if (!driven) {
    inputs.health.cause = (uint8_t)CRUX_CAUSE_NOT_CALIBRATED;
    inputs.opening_m = NAN;
    inputs.speed_m_s = NAN;
  } else if (drive_port_tick()) {
    search();
    crux_gripper_drive_measure(&drive, &inputs);
  } else {
    inputs.health.cause = (uint8_t)CRUX_CAUSE_SENSOR;
    inputs.opening_m = NAN;
    inputs.speed_m_s = NAN;
  }
  inputs.temperature_degC = drive_port_temperature_degC();
  inputs.bus_off = fdcan_recover();
  inputs.driver_fault = drive_port_driver_fault();
}

static void read_sensor(void) {
  crux_frame frame;
  fdcan_sensor_recover();
  while (fdcan_sensor_receive(&frame)) {
    crux_wrench_sensor_on_frame(&sensor, &frame);
  }
  if (crux_wrench_sensor_tick(&sensor, BOARD_TICK_US, &frame)) {
    fdcan_sensor_send(&frame);
  }
  (void)memcpy(inputs.wrench, sensor.wrench, sizeof(inputs.wrench));
  inputs.wrench_valid = crux_wrench_sensor_valid(&sensor);
  inputs.wrench_overloaded = sensor.overloaded;
}

/// The node alone, from one interrupt to the next: also while its services wait for the flash. True once a tick.
static bool run_node(void) {
  crux_frame frame;
  const bool tick = board_wait_for_tick();
  while (fdcan_receive(&frame)) {
    crux_gripper_node_on_frame(&node, &frame);
    update_port_keep(&requests, &frame);
  }
  if (tick) {
    measure();
    read_sensor();
    crux_gripper_node_tick(&node, BOARD_TICK_S, &inputs, &outputs);
    if (driven) {
      const bool may_release = node.state == (uint8_t)CRUX_STATE_TRACK;
      crux_gripper_drive_tick(&drive, BOARD_TICK_S, outputs.force_N, may_release, inputs.temperature_degC);
    }
    board_feed_watchdog(update_port_is_kept());
  }
  crux_gripper_node_publish(&node, &inputs);
  while (fdcan_can_send() && crux_link_take_frame(&node.link, &frame)) {
    fdcan_send(&frame);
  }
  return tick;
}

static void wait_for_flash(void) { (void)run_node(); }

int main(void) {
  board_init();
  const uint8_t limb = board_strapped_limb();
  crux_gripper_parameters parameters = node_table_grippers[limb];
  const crux_gripper_drive_parameters *motor = &node_table_gripper_drives[limb];
  if ((crux_gripper_parameters_fault(&parameters) != NULL) || (crux_motor_parameters_fault(&motor->motor) != NULL) ||
      (crux_screw_parameters_fault(&motor->screw) != NULL)) {
    return 1;
  }
  crux_service_init(&service, (uint8_t)CRUX_CAN_NODE_GRIPPER, update_port_init((uint32_t)CRUX_KIND_GRIPPER),
                    node_table_hash, &parameters, flash_port_store());
  crux_gripper_node_init(&node, limb, node_table_hash, &parameters);
  update_port_offer(&service);
  crux_service_attach(&service, &node.parameters);
  driven = start(motor, &parameters);
  fdcan_init((uint16_t)CRUX_CAN_ID_SYNC, (uint16_t)CRUX_CAN_ID_GRIPPER_COMMAND, (uint16_t)CRUX_CAN_ID_GRIPPER_REQUEST,
             (uint16_t)CRUX_CAN_ID_BROADCAST, (uint16_t)CRUX_CAN_ID_HOST_HEARTBEAT);
  crux_wrench_sensor_init(&sensor);
  fdcan_sensor_init((uint16_t)CRUX_WRENCH_SENSOR_FIRST_ID, (uint16_t)CRUX_WRENCH_SENSOR_SECOND_ID);
  requests.id = (uint16_t)CRUX_CAN_ID_GRIPPER_REQUEST;
  measure();
  flash_port_while_busy(wait_for_flash);
  for (;;) {
    const bool tick = run_node();
    update_port_serve(&service, &requests, tick, &node.state, &node.guard);
  }
}
