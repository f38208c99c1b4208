#include "crux_emulated.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>

static _Thread_local char last_error[256];

const char *crux_emulated_error(void) { return last_error; }

emulated_node *crux_emulated_open(const char *image, int limb, int node, const emulated_world *world) {
  if ((limb < 0) || (limb > 3) || (node < 1) || (node > EMULATED_GRIPPER)) {
    (void)snprintf(last_error, sizeof(last_error), "no node %d on limb %d: nodes are 1..7, limbs 0..3", node, limb);
    return NULL;
  }
  return emulated_node_new(image, limb, node, world, last_error, sizeof(last_error));
}

void crux_emulated_close(emulated_node *node) { emulated_node_delete(node); }

const crux_outside_node *crux_emulated_port(emulated_node *node) { return &node->port; }

const char *crux_emulated_fault(const emulated_node *node) { return node->chip.core.fault; }

uint64_t crux_emulated_instructions(const emulated_node *node) { return node->chip.core.instructions; }

cortex_cost crux_emulated_cost(const emulated_node *node, uint32_t exception) {
  const cortex_cost nothing = {0};
  return (exception < CORTEX_EXCEPTIONS) ? node->chip.core.cost[exception] : nothing;
}
