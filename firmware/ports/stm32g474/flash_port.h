/// The chip's own flash, in dual-bank mode: two banks of 128 pages. A processor that reads from a bank that is written
/// waits, an erase takes 22 ms, and the current loop would wait with it. So a program writes to the bank that it does
/// not run from; its own marks are the exception, a double word each. The board's calibration is never touched.
#ifndef CRUX_STM32G474_FLASH_PORT_H
#define CRUX_STM32G474_FLASH_PORT_H

#include <stdbool.h>

#include "boot.h"
#include "store.h"

/// Where the node's parameters are kept.
const crux_store *flash_port_store(void);

/// The slot whose program runs, CRUX_NO_SLOT for the boot stage and for programs linked for the flash's start.
uint8_t flash_port_running_slot(void);

/// The two slots; the image that runs changes the other one only, the boot stage only marks.
void flash_port_slots(crux_slots *slots, uint32_t kind);

/// For the handler of the non-maskable interrupt: true when it came from a read of a double word that the flash cannot
/// correct, which the reader now knows of.
bool flash_port_on_nmi(void);

/// What to do, again and again, while the flash is busy; nothing before.
void flash_port_while_busy(void (*function)(void));

#endif
