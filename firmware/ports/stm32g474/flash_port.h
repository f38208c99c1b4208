/// The chip's own flash, in dual-bank mode: two banks of 128 pages. Programs run from the first bank while the second
/// one is written, so the processor never waits for it. The last three pages: two of the parameter store, then the
/// board's calibration, which is never touched.
#ifndef CRUX_STM32G474_FLASH_PORT_H
#define CRUX_STM32G474_FLASH_PORT_H

#include <stdbool.h>

#include "store.h"

/// Where the node's parameters are kept.
extern const crux_store flash_port_store;

/// For the handler of the non-maskable interrupt: true when it came from a read of a double word that the flash cannot
/// correct, which the reader now knows of.
bool flash_port_on_nmi(void);

#endif
