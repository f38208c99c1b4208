/// The peripherals' vectors of a node's image, and what it does where its processor fails.
#include "board.h"
#include "drive_port.h"
#include "registers.h"

void fdcan_on_interrupt(void);
void drive_port_on_sample(void);

/// A processor fault. The field stands from now on, at the strength the winding bears for good: the rotor's magnets
/// lock to it and the joint stays, without the processor. The node falls silent and the host sees that. Neither an open
/// bridge (limp) nor shorted phases (the joint creeps down) would do, nor the last duties as they are: they hold the
/// load of that moment and no more. A restart would open the bridge, and again after every further fault. Only an image
/// on trial is restarted, by the watchdog.
void fault_handler(void) {
  drive_port_stand();
  for (;;) {
    board_stay_awake();
  }
}

typedef void (*vector)(void);

__attribute__((section(".interrupts"), used)) static const vector interrupts[102] = {
    [IRQ_ADC1_2] = drive_port_on_sample,
    [IRQ_FDCAN1_IT0] = fdcan_on_interrupt,
};
