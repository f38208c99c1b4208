/// Vector table and the way from reset to main.
#include <stdint.h>

#include "board.h"
#include "drive_port.h"
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
void fdcan_on_interrupt(void);
void drive_port_on_sample(void);
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

/// A processor fault. The field stands from now on, at the strength the winding bears for good: the rotor's magnets
/// lock to it and the joint stays, without the processor. The node falls silent and the host sees that. Neither an open
/// bridge (limp) nor shorted phases (the joint creeps down) would do, nor the last duties as they are: they hold the
/// load of that moment and no more. A restart would open the bridge, and again after every further fault. Only an image
/// on trial is restarted, by the watchdog.
static void fault_handler(void) {
  drive_port_stand();
  for (;;) {
    board_stay_awake();
  }
}

/// The flash found a double word it cannot correct, where a write was cut short for instance. Where the store is read
/// that is expected, anywhere else a fault.
static void nmi_handler(void) {
  if (!flash_port_on_nmi()) {
    fault_handler();
  }
}

typedef void (*vector)(void);

__attribute__((section(".vectors"), used)) static const vector vectors[16 + 102] = {
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
    [16U + IRQ_ADC1_2] = drive_port_on_sample,
    [16U + IRQ_FDCAN1_IT0] = fdcan_on_interrupt,
};
