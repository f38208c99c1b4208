/// What lies where in the flash. Addresses count from its start; slots have a bank each.
///   0x00000  boot stage
///   0x06800  two pages of the parameter store that the program of slot 1 writes
///   0x07800  public key that images must be signed with (all ones: none)
///   0x08000  slot 0
///   0x40000  slot 1
///   0x7E800  two pages of the parameter store that every other program writes
///   0x7F800  the board's calibration
#ifndef CRUX_STM32G474_FLASH_LAYOUT_H
#define CRUX_STM32G474_FLASH_LAYOUT_H

#define FLASH_START 0x08000000UL
#define FLASH_STORE_0 0x06800UL
#define FLASH_KEY 0x07800UL
#define FLASH_SLOT_0 0x08000UL
#define FLASH_SLOT_1 0x40000UL
#define FLASH_SLOT_BYTES 0x38000UL
#define FLASH_STORE_1 0x7E800UL
#define FLASH_CALIBRATION 0x7F800UL

#endif
