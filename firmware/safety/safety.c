#include "safety.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "codec.h"

/// Commands come as rounded numbers: a clamp by less than this share of the range is no violation worth a report.
#define CLAMP_TOLERANCE 1.0e-3F

float crux_clamp(float value, float lower, float upper) {
  float result = value;
  if (result < lower) {
    result = lower;
  }
  if (result > upper) {
    result = upper;
  }
  return result;
}

bool crux_makes_sense(float measured, float lower, float upper) { return (measured >= lower) && (measured <= upper); }

static uint32_t saturating_add(uint32_t value, uint32_t step, uint32_t limit) {
  return (step >= (limit - value)) ? limit : (value + step);
}

static uint8_t receive(crux_guard *guard, crux_receiver *receiver, const crux_frame *frame, uint8_t length) {
  uint8_t cause = (uint8_t)CRUX_CAUSE_NONE;
  if (frame->length != length) {
    cause = (uint8_t)CRUX_CAUSE_INVALID_COMMAND;
  } else {
    // Judged on a copy: a frame outside the window must not move the counter that the next one is measured by.
    struct crux_e2e_receiver next = receiver->e2e;
    const enum crux_e2e_verdict verdict = crux_e2e_check(frame->id, frame->data, frame->length, &next);
    const uint8_t step = (uint8_t)(next.counter - receiver->e2e.counter);
    const uint8_t behind = (uint8_t)(receiver->e2e.counter - next.counter);
    const bool twice = (verdict == CRUX_E2E_REPEATED) && (memcmp(frame->data, receiver->last, length) == 0);
    if (verdict == CRUX_E2E_CORRUPT) {
      cause = (uint8_t)CRUX_CAUSE_E2E_CRC;
    } else if (twice) {
      cause = (uint8_t)CRUX_CAUSE_E2E_COUNTER;
    } else if (receiver->e2e.seen && ((step == 0U) || (step > guard->window))) {
      cause = (uint8_t)CRUX_CAUSE_E2E_COUNTER;
      receiver->whole = (uint8_t)saturating_add(receiver->whole, 1U, UINT8_MAX);
      if (behind <= guard->window) {
        guard->alone_us = 0U;
        guard->command_fresh = false;
      }
    } else {
      receiver->whole = (uint8_t)saturating_add(receiver->whole, 1U, UINT8_MAX);
      receiver->e2e = next;
      receiver->heard = true;
      (void)memcpy(receiver->last, frame->data, length);
    }
  }
  return cause;
}

static void age(crux_receiver *receiver, uint32_t dt_us, uint32_t limit_us) {
  receiver->silent_us = receiver->heard ? 0U : saturating_add(receiver->silent_us, dt_us, limit_us);
  receiver->heard = false;
  if (receiver->silent_us >= limit_us) {
    receiver->e2e.seen = false;
  }
}

void crux_guard_init(crux_guard *guard, uint32_t period_us, uint32_t watchdog_cycles) {
  *guard = (crux_guard){0};
  guard->limit_us = period_us * watchdog_cycles;
  guard->alone_us = guard->limit_us;
  guard->window = (uint8_t)watchdog_cycles;
}

/// How many frames the sender of a valid one says it sent since the valid one before.
static uint8_t steps(const struct crux_e2e_receiver *before, const crux_receiver *receiver, uint8_t window) {
  return before->seen ? (uint8_t)(receiver->e2e.counter - before->counter) : window;
}

uint8_t crux_guard_sync(crux_guard *guard, const crux_frame *frame) {
  const struct crux_e2e_receiver before = guard->sync.e2e;
  const uint8_t cause = receive(guard, &guard->sync, frame, (uint8_t)CRUX_CAN_LENGTH_SYNC);
  if (cause == (uint8_t)CRUX_CAUSE_NONE) {
    struct crux_can_sync_t sync;
    (void)crux_can_sync_unpack(&sync, frame->data, frame->length);
    guard->cycle = sync.cycle;
    guard->answer_due = true;
    guard->by_broadcast = false;
    guard->take = guard->command_waiting && (guard->command.whole <= steps(&before, &guard->sync, guard->window)) &&
                  !guard->broadcast.e2e.seen && !crux_guard_has_rival(guard);
    guard->command_fresh = guard->command_fresh || guard->take;
    guard->command_waiting = false;
    guard->command.whole = 0U;
  }
  return cause;
}

uint8_t crux_guard_broadcast(crux_guard *guard, const crux_frame *frame, bool sensible) {
  const struct crux_e2e_receiver before = guard->broadcast.e2e;
  const uint8_t cause = receive(guard, &guard->broadcast, frame, (uint8_t)CRUX_CAN_LENGTH_BROADCAST);
  if (cause == (uint8_t)CRUX_CAUSE_NONE) {
    struct crux_can_broadcast_header_t header;
    (void)crux_can_broadcast_header_unpack(&header, frame->data, frame->length);
    guard->cycle = header.cycle;
    guard->answer_due = true;
    guard->by_broadcast = true;
    guard->take = sensible && (guard->broadcast.whole <= steps(&before, &guard->broadcast, guard->window)) &&
                  !guard->command.e2e.seen && !crux_guard_has_rival(guard);
    guard->command_fresh = guard->command_fresh || guard->take;
    guard->broadcast.whole = 0U;
  }
  return cause;
}

uint8_t crux_guard_command(crux_guard *guard, const crux_frame *frame, uint8_t length) {
  return receive(guard, &guard->command, frame, length);
}

bool crux_guard_has_rival(const crux_guard *guard) { return guard->alone_us < guard->limit_us; }

bool crux_guard_is_commanded(const crux_guard *guard) {
  return (guard->silent_us < guard->limit_us) || crux_guard_has_rival(guard);
}

bool crux_guard_tick(crux_guard *guard, uint32_t dt_us) {
  bool tripped = false;
  age(&guard->sync, dt_us, guard->limit_us);
  age(&guard->command, dt_us, guard->limit_us);
  age(&guard->broadcast, dt_us, guard->limit_us);
  if (crux_guard_has_rival(guard)) {
    tripped = guard->silent_us < guard->limit_us;
    guard->silent_us = guard->limit_us;
    guard->alone_us = saturating_add(guard->alone_us, dt_us, guard->limit_us);
  } else if (guard->command_fresh) {
    guard->command_fresh = false;
    guard->silent_us = 0U;
  } else if (guard->silent_us < guard->limit_us) {
    guard->silent_us = saturating_add(guard->silent_us, dt_us, guard->limit_us);
    tripped = guard->silent_us >= guard->limit_us;
  } else {
    // silent for longer: it tripped when the limit was reached
  }
  return tripped;
}

static bool is_known_mode(uint8_t mode) {
  return (mode == (uint8_t)CRUX_MODE_HOLD) || (mode == (uint8_t)CRUX_MODE_TRACK) || (mode == (uint8_t)CRUX_MODE_REARM);
}

/// Clamps the asked values of a command and judges its content.
static uint8_t judge_joint(const crux_joint_parameters *parameters, float torque_Nm, crux_joint_command *command) {
  const float range_rad = parameters->position_max_rad - parameters->position_min_rad;
  const float velocity_limit_rad_s = parameters->velocity_limit_rad_s;
  command->torque_Nm = crux_clamp(torque_Nm, -parameters->torque_limit_Nm, parameters->torque_limit_Nm);
  command->position_rad =
      crux_clamp(command->asked_position_rad, parameters->position_min_rad, parameters->position_max_rad);
  command->velocity_rad_s = crux_clamp(command->asked_velocity_rad_s, -velocity_limit_rad_s, velocity_limit_rad_s);
  command->position_clamped =
      fabsf(command->asked_position_rad - command->position_rad) > (CLAMP_TOLERANCE * range_rad);
  command->velocity_clamped =
      fabsf(command->asked_velocity_rad_s - command->velocity_rad_s) > (CLAMP_TOLERANCE * velocity_limit_rad_s);
  // Gains are scaled integers, none is below zero.
  const bool limp = (command->mode == (uint8_t)CRUX_MODE_TRACK) && !(command->position_gain_Nm_rad > 0.0F);
  const bool sensible = is_known_mode(command->mode) && (isfinite(command->asked_position_rad) != 0) && !limp;
  return (uint8_t)(sensible ? CRUX_CAUSE_NONE : CRUX_CAUSE_INVALID_COMMAND);
}

uint8_t crux_joint_command_accept(const crux_frame *frame, const crux_joint_parameters *parameters,
                                  crux_joint_command *command) {
  struct crux_can_joint_command_t raw;
  uint8_t cause = (uint8_t)CRUX_CAUSE_INVALID_COMMAND;
  if (crux_can_joint_command_unpack(&raw, frame->data, frame->length) == 0) {
    command->mode = raw.mode;
    command->asked_position_rad = crux_can_joint_command_position_rad_decode(raw.position_rad);
    command->asked_velocity_rad_s = crux_can_joint_command_velocity_rad_s_decode(raw.velocity_rad_s);
    command->position_gain_Nm_rad = crux_can_joint_command_kp_nm_rad_decode(raw.kp_nm_rad);
    command->velocity_gain_Nms_rad = crux_can_joint_command_kd_nms_rad_decode(raw.kd_nms_rad);
    cause = judge_joint(parameters, crux_can_joint_command_torque_nm_decode(raw.torque_nm), command);
  }
  return cause;
}

uint8_t crux_joint_broadcast_accept(const crux_frame *frame, uint8_t node, const crux_joint_parameters *parameters,
                                    crux_joint_command *command) {
  uint8_t cause = (uint8_t)CRUX_CAUSE_INVALID_COMMAND;
  if ((frame->length == (uint8_t)CRUX_CAN_LENGTH_BROADCAST) && (node <= (uint8_t)CRUX_CAN_BROADCAST_JOINTS)) {
    const uint32_t first = CRUX_CAN_OFFSET_BROADCAST_JOINT + (CRUX_CAN_LENGTH_BROADCAST_JOINT * ((uint32_t)node - 1U));
    struct crux_can_broadcast_joint_t raw;
    (void)crux_can_broadcast_joint_unpack(&raw, &frame->data[first], CRUX_CAN_LENGTH_BROADCAST_JOINT);
    command->mode = raw.mode;
    command->asked_position_rad = crux_can_broadcast_joint_position_rad_decode(raw.position_rad);
    command->asked_velocity_rad_s = crux_can_broadcast_joint_velocity_rad_s_decode(raw.velocity_rad_s);
    command->position_gain_Nm_rad = crux_can_broadcast_joint_kp_nm_rad_decode(raw.kp_nm_rad);
    command->velocity_gain_Nms_rad = crux_can_broadcast_joint_kd_nms_rad_decode(raw.kd_nms_rad);
    cause = judge_joint(parameters, crux_can_broadcast_joint_torque_nm_decode(raw.torque_nm), command);
  }
  return cause;
}

static uint8_t judge_gripper(const crux_gripper_parameters *parameters, float speed_limit_m_s, float force_limit_N,
                             crux_gripper_command *command) {
  const float range_m = parameters->opening_max_m - parameters->opening_min_m;
  command->opening_m = crux_clamp(command->asked_opening_m, parameters->opening_min_m, parameters->opening_max_m);
  command->opening_clamped = fabsf(command->asked_opening_m - command->opening_m) > (CLAMP_TOLERANCE * range_m);
  command->speed_limit_m_s = crux_clamp(speed_limit_m_s, 0.0F, parameters->speed_limit_m_s);
  command->force_limit_N = crux_clamp(force_limit_N, 0.0F, parameters->force_limit_N);
  const bool limp = (command->mode == (uint8_t)CRUX_MODE_TRACK) && !(force_limit_N > 0.0F);
  const bool sensible = is_known_mode(command->mode) && (isfinite(command->asked_opening_m) != 0) && !limp;
  return (uint8_t)(sensible ? CRUX_CAUSE_NONE : CRUX_CAUSE_INVALID_COMMAND);
}

uint8_t crux_gripper_command_accept(const crux_frame *frame, const crux_gripper_parameters *parameters,
                                    crux_gripper_command *command) {
  struct crux_can_gripper_command_t raw;
  uint8_t cause = (uint8_t)CRUX_CAUSE_INVALID_COMMAND;
  if (crux_can_gripper_command_unpack(&raw, frame->data, frame->length) == 0) {
    command->mode = raw.mode;
    command->asked_opening_m = crux_can_gripper_command_opening_m_decode(raw.opening_m);
    cause = judge_gripper(parameters, crux_can_gripper_command_speed_limit_m_s_decode(raw.speed_limit_m_s),
                          crux_can_gripper_command_force_limit_n_decode(raw.force_limit_n), command);
  }
  return cause;
}

uint8_t crux_gripper_broadcast_accept(const crux_frame *frame, const crux_gripper_parameters *parameters,
                                      crux_gripper_command *command) {
  uint8_t cause = (uint8_t)CRUX_CAUSE_INVALID_COMMAND;
  if (frame->length == (uint8_t)CRUX_CAN_LENGTH_BROADCAST) {
    struct crux_can_broadcast_gripper_t raw;
    (void)crux_can_broadcast_gripper_unpack(&raw, &frame->data[CRUX_CAN_OFFSET_BROADCAST_GRIPPER],
                                            CRUX_CAN_LENGTH_BROADCAST_GRIPPER);
    command->mode = raw.mode;
    command->asked_opening_m = crux_can_broadcast_gripper_opening_m_decode(raw.opening_m);
    cause = judge_gripper(parameters, crux_can_broadcast_gripper_speed_limit_m_s_decode(raw.speed_limit_m_s),
                          crux_can_broadcast_gripper_force_limit_n_decode(raw.force_limit_n), command);
  }
  return cause;
}
