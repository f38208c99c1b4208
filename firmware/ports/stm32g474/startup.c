/// Vector table and the way from reset to main.
#include <stdint.h>

#include "registers.h"

extern uint32_t stack_top;
extern uint32_t data_load;
extern uint32_t data_start;
extern uint32_t data_end;
extern uint32_t bss_start;
extern uint32_t bss_end;

int main(void);
void board_on_systick(void);
void fdcan_on_interrupt(void);
void reset_handler(void);

void reset_handler(void) {
  SCB_CPACR |= 0xFUL << 20;  // the floating-point unit
  __asm volatile("dsb\n isb" ::: "memory");
  const uint32_t *from = &data_load;
  for (uint32_t *to = &data_start; to < &data_end; to++) {
    *to = *from;
    from++;
  }
  for (uint32_t *to = &bss_start; to < &bss_end; to++) {
    *to = 0U;
  }
  (void)main();
  for (;;) {
  }
}

/// A processor fault. The motor driver keeps its last current, so the joint keeps the torque that held it; the node
/// falls silent and the host sees that. A restart would forget the incremental encoder's zero.
static void fault_handler(void) {
  for (;;) {
  }
}

typedef void (*vector)(void);

__attribute__((section(".vectors"), used)) static const vector vectors[16 + 102] = {
    (vector)(uintptr_t)&stack_top,
    reset_handler,
    fault_handler,  // NMI
    fault_handler,  // HardFault
    fault_handler,  // MemManage
    fault_handler,  // BusFault
    fault_handler,  // UsageFault
    [11] = fault_handler,
    [12] = fault_handler,
    [14] = fault_handler,
    [15] = board_on_systick,
    [16U + IRQ_FDCAN1_IT0] = fdcan_on_interrupt,
};
