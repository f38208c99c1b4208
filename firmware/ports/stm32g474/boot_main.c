/// The boot stage: starts the image of the slot that crux_boot chooses. It takes no requests and drives nothing; with
/// no valid image it sleeps.
#include <stddef.h>

#include "board.h"
#include "boot.h"
#include "codec.h"
#include "flash_layout.h"
#include "flash_port.h"
#include "registers.h"

/// Leaves the chip as a reset would, but for its clocks and pins.
_Noreturn static void start(uint32_t address) {
  const uint32_t *vectors = (const uint32_t *)(FLASH_START + address + CRUX_SLOT_PAYLOAD);
  SYST_CSR = 0UL;
  SCB_VTOR = (uint32_t)(uintptr_t)vectors;
  __asm volatile(
      "dsb\n isb\n"
      "msr msp, %0\n"
      "bx %1\n"
      :
      : "r"(vectors[0]), "r"(vectors[1])
      : "memory");
  __builtin_unreachable();
}

void fault_handler(void) {
  for (;;) {
  }
}

int main(void) {
  board_init();
  crux_slots slots;
  crux_running running;
  const bool is_joint = board_strapped_node() != (uint8_t)CRUX_CAN_NODE_GRIPPER;
  flash_port_slots(&slots, is_joint ? (uint32_t)CRUX_KIND_JOINT : (uint32_t)CRUX_KIND_GRIPPER);
  if (crux_boot(&slots, &running)) {
    if (!running.confirmed) {
      board_start_watchdog();
    }
    start(slots.address[running.slot]);
  }
  for (;;) {
    __asm volatile("wfi" ::: "memory");
  }
}
