/// Vector table of the boot stage. It uses no interrupts.
#include <stdint.h>

#include "flash_port.h"

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
  const uint32_t *from = &data_load;
  for (uint32_t *to = &data_start; to < &data_end; to++) {
    *to = *from;
    from++;
  }
  for (uint32_t *to = &bss_start; to < &bss_end; to++) {
    *to = 0U;
  }
  (void)main();
}

static void fault_handler(void) {
  for (;;) {
  }
}

/// A double word that the flash cannot correct: of an image or a mark whose writing was cut short.
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
    fault_handler,
    fault_handler,
    fault_handler,
    fault_handler,
    [11] = fault_handler,
    [12] = fault_handler,
    [14] = fault_handler,
    [15] = board_on_systick,
};
