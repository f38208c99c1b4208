#include "robot_nodes.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

_Thread_local char crux_nodes_last_error[CRUX_NODES_ERROR_BYTES];

const char *crux_nodes_error(void) { return crux_nodes_last_error; }

bool crux_nodes_failure(const char *what) {
  (void)snprintf(crux_nodes_last_error, sizeof(crux_nodes_last_error), "%s: %s", what, strerror(errno));
  return false;
}

bool crux_nodes_bus_failure(int limb_index, const char *what) {
  (void)snprintf(crux_nodes_last_error, sizeof(crux_nodes_last_error), "bus of limb %d: %s: %s", limb_index, what,
                 strerror(errno));
  return false;
}

bool crux_nodes_exists(int limb_index, int node) {
  const bool found = (limb_index >= 0) && (limb_index < CRUX_LIMBS) && (node >= 1) && (node <= NODES_PER_LIMB);
  if (!found) {
    (void)snprintf(crux_nodes_last_error, sizeof(crux_nodes_last_error),
                   "no node %d on limb %d: nodes are 1..%d, limbs 0..%d", node, limb_index, NODES_PER_LIMB,
                   CRUX_LIMBS - 1);
  }
  return found;
}

bool crux_interference_use_up(uint32_t *count) {
  const bool left = *count > 0U;
  *count -= left ? 1U : 0U;
  return left;
}

/// Marsaglia's xorshift: good enough to choose frames, and the same everywhere.
bool crux_interference_loses(interference *disturbed) {
  bool lost = disturbed->lost_of_2_32 == UINT32_MAX;
  if (!lost && (disturbed->lost_of_2_32 > 0U)) {
    disturbed->random ^= disturbed->random << 13U;
    disturbed->random ^= disturbed->random >> 17U;
    disturbed->random ^= disturbed->random << 5U;
    lost = disturbed->random < disturbed->lost_of_2_32;
  }
  return lost;
}

bool crux_interference_powers(const interference *disturbed) { return disturbed->supply == (uint8_t)CRUX_POWERED; }
