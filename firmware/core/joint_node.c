#include "joint_node.h"

#include <math.h>

void crux_joint_node_init(crux_joint_node *node, uint8_t limb, uint8_t number, uint32_t parameter_hash,
                          const crux_joint_parameters *parameters) {
  *node = (crux_joint_node){0};
  crux_link_init(&node->link, (uint8_t)CRUX_KIND_JOINT, limb, number, parameter_hash);
  crux_guard_init(&node->guard, parameters->period_us, parameters->watchdog_cycles);
  node->parameters = *parameters;
  node->position_gain_Nm_rad = parameters->position_gain_Nm_rad;
  node->velocity_gain_Nms_rad = parameters->velocity_gain_Nms_rad;
  node->state = (uint8_t)CRUX_STATE_BOOT;
}

void crux_joint_node_on_frame(crux_joint_node *node, const crux_frame *frame) {
  if (frame->id == (uint16_t)CRUX_CAN_ID_SYNC) {
    if (crux_link_hear_sync(&node->link, &node->guard, frame)) {
      node->taken = node->pending;
    }
  } else if (frame->id == (uint16_t)CRUX_CAN_ID_JOINT_COMMAND(node->link.node)) {
    crux_joint_command command;
    const uint8_t content = crux_joint_command_accept(frame, &node->parameters, &command);
    if (crux_link_hear_command(&node->link, &node->guard, frame, CRUX_CAN_LENGTH_JOINT_COMMAND, content)) {
      node->pending = command;
    }
  } else if (frame->id == (uint16_t)CRUX_CAN_ID_BROADCAST) {
    crux_joint_command command;
    const uint8_t content = crux_joint_broadcast_accept(frame, node->link.node, &node->parameters, &command);
    if (crux_link_hear_broadcast(&node->link, &node->guard, frame, content)) {
      node->taken = command;
    }
  } else {
    crux_link_hear_host(&node->link, frame);
  }
}

static void stop(crux_joint_node *node) {
  if (node->state == (uint8_t)CRUX_STATE_TRACK) {
    node->state = (uint8_t)CRUX_STATE_DECELERATE;
  } else if (node->state == (uint8_t)CRUX_STATE_BOOT) {
    node->state = (uint8_t)CRUX_STATE_HOLD;
  } else {
    // already at rest or on the way to it; a fault stays one
  }
}

static float position_torque(const crux_joint_node *node) {
  const float torque_Nm =
      (node->position_gain_Nm_rad * (node->setpoint_rad - node->last_position_rad)) + node->feedforward_Nm;
  return crux_clamp(torque_Nm, -node->parameters.torque_limit_Nm, node->parameters.torque_limit_Nm);
}

static void rearm(crux_joint_node *node, const crux_joint_inputs *inputs, bool measured) {
  if ((node->state == (uint8_t)CRUX_STATE_FAULT) && measured) {
    // The joint may have moved unseen: what holds it now becomes feed-forward, and where it is the setpoint.
    node->feedforward_Nm = position_torque(node);
    node->setpoint_rad = inputs->position_rad;
    node->last_position_rad = inputs->position_rad;
    node->state = (uint8_t)CRUX_STATE_HOLD;
  }
  if (node->state != (uint8_t)CRUX_STATE_FAULT) {
    node->latched = false;
    crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_COMMAND_TIMEOUT, false, 0U);
    stop(node);
  }
}

static void remember(crux_joint_node *node) {
  node->before = (crux_joint_law){.setpoint_rad = node->setpoint_rad,
                                  .setpoint_rate_rad_s = node->setpoint_rate_rad_s,
                                  .velocity_setpoint_rad_s = node->velocity_setpoint_rad_s,
                                  .feedforward_Nm = node->feedforward_Nm,
                                  .position_gain_Nm_rad = node->position_gain_Nm_rad,
                                  .velocity_gain_Nms_rad = node->velocity_gain_Nms_rad};
}

static void undo(crux_joint_node *node) {
  node->setpoint_rad = node->before.setpoint_rad;
  node->setpoint_rate_rad_s = node->before.setpoint_rate_rad_s;
  node->velocity_setpoint_rad_s = node->before.velocity_setpoint_rad_s;
  node->feedforward_Nm = node->before.feedforward_Nm;
  node->position_gain_Nm_rad = node->before.position_gain_Nm_rad;
  node->velocity_gain_Nms_rad = node->before.velocity_gain_Nms_rad;
}

static void obey(crux_joint_node *node, const crux_joint_inputs *inputs, bool measured) {
  const crux_joint_command *command = &node->taken;
  if (command->mode == (uint8_t)CRUX_MODE_REARM) {
    rearm(node, inputs, measured);
  } else if (command->mode == (uint8_t)CRUX_MODE_HOLD) {
    stop(node);
  } else if (!node->latched) {
    remember(node);
    node->state = (uint8_t)CRUX_STATE_TRACK;
    node->feedforward_Nm = command->torque_Nm;
    node->position_gain_Nm_rad = command->position_gain_Nm_rad;
    node->velocity_gain_Nms_rad = command->velocity_gain_Nms_rad;
  } else {
    // latched: a TRACK command changes nothing
  }
}

/// `rival`: the command obeyed last may have been a second sender's; nothing of it stays.
static void latch(crux_joint_node *node, uint32_t silent_us, bool rival) {
  if (rival) {
    undo(node);
  }
  node->latched = true;
  node->link.counters.timeouts++;
  crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_COMMAND_TIMEOUT, true, silent_us);
  stop(node);
}

/// No joint is a whole range out of its limits, or this many times faster than its limit.
#define SENSELESS_SPEEDS 100.0F

/// Takes in the measurement. Losing it is a latched fault, seeing it again needs a REARM.
static bool measure(crux_joint_node *node, const crux_joint_inputs *inputs) {
  const crux_joint_parameters *limits = &node->parameters;
  const float range_rad = limits->position_max_rad - limits->position_min_rad;
  const float fastest_rad_s = SENSELESS_SPEEDS * limits->velocity_limit_rad_s;
  const bool measured = crux_makes_sense(inputs->position_rad, limits->position_min_rad - range_rad,
                                         limits->position_max_rad + range_rad) &&
                        crux_makes_sense(inputs->velocity_rad_s, -fastest_rad_s, fastest_rad_s);
  if (measured && !node->has_seen) {
    node->has_seen = true;
    node->setpoint_rad = inputs->position_rad;
    node->last_position_rad = inputs->position_rad;
  }
  if (measured && (node->state != (uint8_t)CRUX_STATE_FAULT)) {
    node->last_position_rad = inputs->position_rad;
  }
  if (!measured && (node->state != (uint8_t)CRUX_STATE_FAULT)) {
    node->state = (uint8_t)CRUX_STATE_FAULT;
    node->latched = true;
    node->setpoint_rate_rad_s = 0.0F;
    node->velocity_setpoint_rad_s = 0.0F;
    crux_link_lost(&node->link, &inputs->health);
  }
  return measured;
}

/// First-order lag towards the command, exact for a command that stays put over dt: x += (1 - exp(-dt/T)) (u - x);
/// the setpoint moves no faster than the velocity limit.
static void track(crux_joint_node *node, float dt_s) {
  const float time_constant_s = node->parameters.setpoint_time_constant_s;
  const float share = (time_constant_s > 0.0F) ? (1.0F - expf(-dt_s / time_constant_s)) : 1.0F;
  const float reach_rad = node->parameters.velocity_limit_rad_s * dt_s;
  const float step_rad = crux_clamp(share * (node->taken.position_rad - node->setpoint_rad), -reach_rad, reach_rad);
  node->setpoint_rad += step_rad;
  node->setpoint_rate_rad_s = step_rad / dt_s;
  node->velocity_setpoint_rad_s += share * (node->taken.velocity_rad_s - node->velocity_setpoint_rad_s);
}

static float towards_zero(float value, float step) {
  return (value > 0.0F) ? fmaxf(value - step, 0.0F) : fminf(value + step, 0.0F);
}

/// Setpoint rate and velocity setpoint fall to zero, each by at most max_deceleration * dt a period.
static void decelerate(crux_joint_node *node, float dt_s) {
  const float step_rad_s = node->parameters.max_deceleration_rad_s2 * dt_s;
  const float before_rad_s = node->setpoint_rate_rad_s;
  node->setpoint_rate_rad_s = towards_zero(before_rad_s, step_rad_s);
  node->velocity_setpoint_rad_s = towards_zero(node->velocity_setpoint_rad_s, step_rad_s);
  // No way to run out of the limits, but a setpoint that is outside of them (found so at boot) is not pulled in.
  node->setpoint_rad = crux_clamp(node->setpoint_rad + (0.5F * (before_rad_s + node->setpoint_rate_rad_s) * dt_s),
                                  fminf(node->setpoint_rad, node->parameters.position_min_rad),
                                  fmaxf(node->setpoint_rad, node->parameters.position_max_rad));
  // Exact zeros: towards_zero ends in them.
  if ((fabsf(node->setpoint_rate_rad_s) + fabsf(node->velocity_setpoint_rad_s)) <= 0.0F) {
    node->state = (uint8_t)CRUX_STATE_HOLD;
  }
}

static float torque(const crux_joint_node *node, const crux_joint_inputs *inputs) {
  float torque_Nm = 0.0F;
  if (!node->has_seen) {
    // Nothing was measured since the start: there is no position to hold and no torque that held one.
  } else if (node->state == (uint8_t)CRUX_STATE_FAULT) {
    torque_Nm = position_torque(node);
  } else {
    torque_Nm = (node->position_gain_Nm_rad * (node->setpoint_rad - inputs->position_rad)) +
                (node->velocity_gain_Nms_rad * (node->velocity_setpoint_rad_s - inputs->velocity_rad_s)) +
                node->feedforward_Nm;
  }
  return crux_clamp(torque_Nm, -node->parameters.torque_limit_Nm, node->parameters.torque_limit_Nm);
}

static void report_conditions(crux_joint_node *node, const crux_joint_inputs *inputs) {
  const bool tracking = node->state == (uint8_t)CRUX_STATE_TRACK;
  crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_POSITION_LIMIT, tracking && node->taken.position_clamped,
                      crux_float_bits(node->taken.asked_position_rad));
  crux_link_condition(&node->link, (uint8_t)CRUX_CAUSE_VELOCITY_LIMIT, tracking && node->taken.velocity_clamped,
                      crux_float_bits(node->taken.asked_velocity_rad_s));
  crux_link_board(&node->link, inputs->bus_off, inputs->driver_fault, &inputs->health, inputs->temperature_degC,
                  node->parameters.temperature_limit_degC);
}

void crux_joint_node_tick(crux_joint_node *node, float dt_s, const crux_joint_inputs *inputs,
                          crux_joint_outputs *outputs) {
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
    track(node, dt_s);
  } else if (node->state == (uint8_t)CRUX_STATE_DECELERATE) {
    decelerate(node, dt_s);
  } else {
    // at rest
  }
  report_conditions(node, inputs);
  outputs->torque_Nm = torque(node, inputs);
  crux_link_tick(&node->link, dt_us, node->state);
}

void crux_joint_node_publish(crux_joint_node *node, const crux_joint_inputs *inputs) {
  if (node->guard.answer_due) {
    const struct crux_can_joint_status_t status = {
        .state = node->state,
        .position_rad = (isfinite(inputs->position_rad) != 0) ? inputs->position_rad : node->last_position_rad,
        .velocity_rad_s = crux_can_joint_status_velocity_rad_s_encode_clipped(inputs->velocity_rad_s),
        .torque_nm = crux_can_joint_status_torque_nm_encode_clipped(inputs->torque_Nm),
        .cycle_echo = (uint16_t)(node->guard.cycle & 0xFFFFU),
        .faults = node->link.faults,
        .temperature_deg_c = crux_whole_degrees(inputs->temperature_degC),
    };
    crux_frame frame = {.id = (uint16_t)CRUX_CAN_ID_JOINT_STATUS(node->link.node),
                        .length = (uint8_t)CRUX_CAN_LENGTH_JOINT_STATUS};
    (void)crux_can_joint_status_pack(frame.data, &status, sizeof(frame.data));
    crux_link_send(&node->link, CRUX_SENT_STATUS, &frame);
    node->guard.answer_due = false;
  }
}
