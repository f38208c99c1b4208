/// Frames of the magnetic encoder AS5047P (14 bits a turn) on SPI: 16 bits, mode 1, most significant bit first.
///
/// A command holds even parity in bit 15, 1 for reading in bit 14 and the address in bits 0..13. The answer comes in
/// the next frame: even parity in bit 15, an error flag of the command before in bit 14, the value in bits 0..13. It
/// was taken when the chip select of the command's frame rose.
#ifndef CRUX_FIRMWARE_DRIVE_AS5047P_H
#define CRUX_FIRMWARE_DRIVE_AS5047P_H

#include <stdbool.h>
#include <stdint.h>

/// Read ANGLECOM (address 0x3FFF): the angle, corrected for the sensor's own delay at constant speed.
#define CRUX_AS5047P_READ_ANGLE 0xFFFFU

/// Read ERRFL (address 0x0001): reading clears the error flag.
#define CRUX_AS5047P_READ_ERRORS 0x4001U

/// Whether an answer has its parity and no error flag. A wire torn to high fails by the flag; one torn to low reads as
/// zero: to the loop a rotor that stands.
bool crux_as5047p_valid(uint16_t answer);

/// Whether an answer says that something was wrong with a command. It goes on saying so until the errors are read.
bool crux_as5047p_flagged(uint16_t answer);

/// Angle of an answer.
uint32_t crux_as5047p_angle(uint16_t answer);

#endif
