#include "gripper_node.h"

#include <math.h>

void crux_gripper_node_init(crux_gripper_node *node, uint8_t limb, uint32_t parameter_hash,
                            const crux_gripper_parameters *parameters) {
  *node = (crux_gripper_node){0};
  crux_link_init(&node->link, (uint8_t)CRUX_KIND_GRIPPER, limb, (uint8_t)CRUX_CAN_NODE_GRIPPER, parameter_hash);
  crux_guard_init(&node->guard, parameters->period_us, parameters->watchdog_cycles);
  node->parameters = *parameters;
  node->force_limit_N = parameters->force_limit_N;
  node->state = (uint8_t)CRUX_STATE_BOOT;
}

void crux_gripper_node_on_frame(crux_gripper_node *node, const crux_frame *frame) {
  if (frame->id == (uint16_t)CRUX_CAN_ID_SYNC) {
    if (crux_link_hear_sync(&node->link, &node->guard, frame)) {
      node->taken = node->pending;
    }
  } else if (frame->id == (uint16_t)CRUX_CAN_ID_GRIPPER_COMMAND) {
    crux_gripper_command command;
    const uint8_t content = crux_gripper_command_accept(frame, &node->parameters, &command);
    if (crux_link_hear_command(&node->link, &node->guard, frame, CRUX_CAN_LENGTH_GRIPPER_COMMAND, content)) {
      node->pending = command;
    }
  } else if (frame->id == (uint16_t)CRUX_CAN_ID_BROADCAST) {
    crux_gripper_command command;
    const uint8_t content = crux_gripper_broadcast_accept(frame, &node->parameters, &command);
    if (crux_link_hear_broadcast(&node->link, &node->guard, frame, content)) {
      node->taken = command;
    }
  } else {
    crux_link_hear_host(&node->link, frame);
  }
}

/// The part of the squeeze that does not depend on speed; closing only.
static float held_force(const crux_gripper_node *node) {
  return crux_clamp(node->parameters.stiffness_N_m * (node->last_opening_m - node->setpoint_m), 0.0F,
                    node->force_limit_N);
}

static void rearm(crux_gripper_node *node, const crux_gripper_inputs *inputs, bool measured) {
  if ((node->state == (uint8_t)CRUX_STATE_FAULT) && measured) {
    // The fingers may have moved unseen: the squeeze stays, its setpoint is counted from where they are now.
    node->setpoint_m = inputs->opening_m - (held_force(node) / node->parameters.stiffness_N_m);
    node->last_opening_m = inputs->opening_m;
    node->state = (uint8_t)CRUX_STATE_HOLD;
  }
  if (node->state != (uint8_t)CRUX_STATE_FAULT) {
    node->latched = false;
    crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_COMMAND_TIMEOUT, false, 0U);
    node->state = (uint8_t)CRUX_STATE_HOLD;
  }
}

static void obey(crux_gripper_node *node, const crux_gripper_inputs *inputs, bool measured) {
  const crux_gripper_command *command = &node->taken;
  if (command->mode == (uint8_t)CRUX_MODE_REARM) {
    rearm(node, inputs, measured);
  } else if (node->latched) {
    // neither TRACK nor HOLD changes anything before REARM
  } else if (command->mode == (uint8_t)CRUX_MODE_TRACK) {
    node->setpoint_before_m = node->setpoint_m;
    node->force_limit_before_N = node->force_limit_N;
    node->state = (uint8_t)CRUX_STATE_TRACK;
    node->force_limit_N = command->force_limit_N;
  } else {
    node->state = (uint8_t)CRUX_STATE_HOLD;
  }
}

/// `rival`: the command obeyed last may have been a second sender's; nothing of it stays that loosens the squeeze.
static void latch(crux_gripper_node *node, uint32_t silent_us, bool rival) {
  if (rival) {
    node->setpoint_m = fminf(node->setpoint_m, node->setpoint_before_m);
    node->force_limit_N = fmaxf(node->force_limit_N, node->force_limit_before_N);
  }
  node->latched = true;
  node->link.counters.timeouts++;
  crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_COMMAND_TIMEOUT, true, silent_us);
  node->state = (uint8_t)CRUX_STATE_HOLD;
}

/// No finger is a whole travel out of its ends, or this many times faster than its limit.
#define SENSELESS_SPEEDS 100.0F

static bool measure(crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  const crux_gripper_parameters *limits = &node->parameters;
  const float travel_m = limits->opening_max_m - limits->opening_min_m;
  const float fastest_m_s = SENSELESS_SPEEDS * limits->speed_limit_m_s;
  const bool measured =
      crux_makes_sense(inputs->opening_m, limits->opening_min_m - travel_m, limits->opening_max_m + travel_m) &&
      crux_makes_sense(inputs->speed_m_s, -fastest_m_s, fastest_m_s);
  if (measured && !node->has_seen) {
    node->has_seen = true;
    node->setpoint_m = inputs->opening_m;
    node->last_opening_m = inputs->opening_m;
  }
  if (measured && (node->state != (uint8_t)CRUX_STATE_FAULT)) {
    node->last_opening_m = inputs->opening_m;
  }
  if (!measured && (node->state != (uint8_t)CRUX_STATE_FAULT)) {
    node->state = (uint8_t)CRUX_STATE_FAULT;
    node->latched = true;
    crux_link_lost(&node->link, &inputs->health);
  }
  return measured;
}

static void track(crux_gripper_node *node, float dt_s, float opening_m) {
  const float reach_m = node->taken.speed_limit_m_s * dt_s;
  const float lead_m = node->force_limit_N / node->parameters.stiffness_N_m;
  node->setpoint_m += crux_clamp(node->taken.opening_m - node->setpoint_m, -reach_m, reach_m);
  node->setpoint_m = crux_clamp(node->setpoint_m, opening_m - lead_m, opening_m + lead_m);
}

static float force(const crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  float force_N = 0.0F;
  if (!node->has_seen) {
    // Nothing was measured since the start; the self-locking screw holds what it holds.
  } else if (node->state == (uint8_t)CRUX_STATE_FAULT) {
    force_N = held_force(node);
  } else {
    const float tracking_lower_N = (node->state == (uint8_t)CRUX_STATE_TRACK) ? -node->force_limit_N : 0.0F;
    force_N = crux_clamp((node->parameters.stiffness_N_m * (inputs->opening_m - node->setpoint_m)) +
                             (node->parameters.damping_Ns_m * inputs->speed_m_s),
                         tracking_lower_N, node->force_limit_N);
  }
  return force_N;
}

static void report_conditions(crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  const bool tracking = node->state == (uint8_t)CRUX_STATE_TRACK;
  crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_POSITION_LIMIT, tracking && node->taken.opening_clamped,
                      crux_float_bits(node->taken.asked_opening_m));
  crux_link_board(&node->link, inputs->bus_off, inputs->driver_fault, &inputs->health, inputs->temperature_degC,
                  node->parameters.temperature_limit_degC);
}

void crux_gripper_node_tick(crux_gripper_node *node, float dt_s, const crux_gripper_inputs *inputs,
                            crux_gripper_outputs *outputs) {
  const uint32_t dt_us = crux_microseconds(dt_s);
  const bool measured = measure(node, inputs);
  if (node->guard.command_fresh) {
    obey(node, inputs, measured);
  }
  const bool rival = crux_guard_has_rival(&node->guard);
  if (crux_guard_tick(&node->guard, dt_us) && (node->state == (uint8_t)CRUX_STATE_TRACK)) {
    latch(node, node->guard.silent_us, rival);
  }
  if (node->state == (uint8_t)CRUX_STATE_TRACK) {
    track(node, dt_s, inputs->opening_m);
  }
  report_conditions(node, inputs);
  outputs->force_N = force(node, inputs);
  crux_link_tick(&node->link, dt_us, node->state);
}

static void publish_status(crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  const struct crux_can_gripper_status_t status = {
      .state = node->state,
      .opening_m = (isfinite(inputs->opening_m) != 0) ? inputs->opening_m : node->last_opening_m,
      .speed_m_s = crux_can_gripper_status_speed_m_s_encode_clipped(inputs->speed_m_s),
      .force_n = crux_can_gripper_status_force_n_encode_clipped(inputs->force_N),
      .cycle_echo = (uint16_t)(node->guard.cycle & 0xFFFFU),
      .faults = node->link.faults,
      .temperature_deg_c = crux_whole_degrees(inputs->temperature_degC),
  };
  crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_GRIPPER_STATUS, .length = (uint8_t)CRUX_CAN_LENGTH_GRIPPER_STATUS};
  (void)crux_can_gripper_status_pack(frame.data, &status, sizeof(frame.data));
  crux_link_send(&node->link, CRUX_SENT_STATUS, &frame);
}

/// FT status bits of a sample: not ready when there is none, overload beyond the sensor's range.
static uint8_t wrench_status(const crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  bool ready = inputs->wrench_valid;
  bool overload = inputs->wrench_overloaded;
  for (uint32_t i = 0U; i < 6U; i++) {
    const float range = (i < 3U) ? node->parameters.force_range_N : node->parameters.moment_range_Nm;
    ready = ready && (isfinite(inputs->wrench[i]) != 0);
    overload = overload || (fabsf(inputs->wrench[i]) > range);
  }
  return (uint8_t)((ready ? 0U : CRUX_FT_NOT_READY) | ((ready && overload) ? CRUX_FT_OVERLOAD : 0U));
}

static void publish_wrench(crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  const struct crux_can_force_torque_t sample = {
      .status = wrench_status(node, inputs),
      .force_x_n = crux_can_force_torque_force_x_n_encode_clipped(inputs->wrench[0]),
      .force_y_n = crux_can_force_torque_force_y_n_encode_clipped(inputs->wrench[1]),
      .force_z_n = crux_can_force_torque_force_z_n_encode_clipped(inputs->wrench[2]),
      .moment_x_nm = crux_can_force_torque_moment_x_nm_encode_clipped(inputs->wrench[3]),
      .moment_y_nm = crux_can_force_torque_moment_y_nm_encode_clipped(inputs->wrench[4]),
      .moment_z_nm = crux_can_force_torque_moment_z_nm_encode_clipped(inputs->wrench[5]),
      .cycle_echo = (uint16_t)(node->guard.cycle & 0xFFFFU),
  };
  crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_FORCE_TORQUE, .length = (uint8_t)CRUX_CAN_LENGTH_FORCE_TORQUE};
  (void)crux_can_force_torque_pack(frame.data, &sample, sizeof(frame.data));
  crux_link_send(&node->link, CRUX_SENT_FORCE_TORQUE, &frame);
}

/// Status and wrench in one frame: the broadcast's answer. Its fields are those of the two frames.
static void publish_answer(crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  const struct crux_can_gripper_answer_t answer = {
      .state = node->state,
      .opening_m = (isfinite(inputs->opening_m) != 0) ? inputs->opening_m : node->last_opening_m,
      .speed_m_s = crux_can_gripper_answer_speed_m_s_encode_clipped(inputs->speed_m_s),
      .force_n = crux_can_gripper_answer_force_n_encode_clipped(inputs->force_N),
      .cycle_echo = (uint16_t)(node->guard.cycle & 0xFFFFU),
      .faults = node->link.faults,
      .temperature_deg_c = crux_whole_degrees(inputs->temperature_degC),
      .wrench_status = wrench_status(node, inputs),
      .force_x_n = crux_can_gripper_answer_force_x_n_encode_clipped(inputs->wrench[0]),
      .force_y_n = crux_can_gripper_answer_force_y_n_encode_clipped(inputs->wrench[1]),
      .force_z_n = crux_can_gripper_answer_force_z_n_encode_clipped(inputs->wrench[2]),
      .moment_x_nm = crux_can_gripper_answer_moment_x_nm_encode_clipped(inputs->wrench[3]),
      .moment_y_nm = crux_can_gripper_answer_moment_y_nm_encode_clipped(inputs->wrench[4]),
      .moment_z_nm = crux_can_gripper_answer_moment_z_nm_encode_clipped(inputs->wrench[5]),
  };
  crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_GRIPPER_ANSWER, .length = (uint8_t)CRUX_CAN_LENGTH_GRIPPER_ANSWER};
  (void)crux_can_gripper_answer_pack(frame.data, &answer, sizeof(frame.data));
  crux_link_send(&node->link, CRUX_SENT_ANSWER, &frame);
}

void crux_gripper_node_publish(crux_gripper_node *node, const crux_gripper_inputs *inputs) {
  if (node->guard.answer_due && node->guard.by_broadcast) {
    publish_answer(node, inputs);
  } else if (node->guard.answer_due) {
    publish_status(node, inputs);
    publish_wrench(node, inputs);
  } else {
    // nobody asked
  }
  node->guard.answer_due = false;
}
