/// The way from reset to main, and the vectors of the processor itself, of every image.
#include <stdint.h>

#include "board.h"
#include "flash_port.h"
#include "registers.h"

extern uint32_t stack_top;
extern uint32_t data_load;
extern uint32_t data_start;
extern uint32_t data_end;
extern uint32_t bss_start;
extern uint32_t bss_end;

int main(void);
void board_on_systick(void);
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

/// The flash found a double word it cannot correct, where a write was cut short for instance. Where the store, an image
/// or a mark is read that is expected, anywhere else a fault.
static void nmi_handler(void) {
  if (!flash_port_on_nmi()) {
    fault_handler();
  }
}

typedef void (*vector)(void);

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    (vector)(uintptr_t)&stack_top,
    reset_handler,
    nmi_handler,
    fault_handler,  // HardFault
    fault_handler,  // MemManage
    fault_handler,  // BusFault
    fault_handler,  // UsageFault
    [11] = fault_handler,
    [12] = fault_handler,
    [14] = fault_handler,
    [15] = board_on_systick,
};
