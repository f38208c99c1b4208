/// The drive's hardware: timer, ADCs and encoders, and the interrupt in which the currents are controlled.
///
/// Timer 1 counts up and down at 20 kHz; an upper switch is on below its duty's count (PWM mode 1). The update event,
/// at the overflow, loads the duties and starts both ADCs' conversions of the phase currents: in the middle of the
/// lower switches' pulses, for the shunts lie under these. Their end starts the interrupt; the duties it computes act
/// from the next update on, for a whole period. The interrupt never waits for the encoder: a frame that started at the
/// end of one interrupt is read at the start of the next, and carries the angle latched at the start of the former.
#ifndef CRUX_STM32G474_DRIVE_PORT_H
#define CRUX_STM32G474_DRIVE_PORT_H

#include <stdbool.h>
#include <stdint.h>

#include "calibration.h"
#include "drive/drive.h"

extern const crux_drive_timing drive_port_timing;

/// Sets up SPI and reads both encoders, before drive_port_start. False when one does not answer: its reading is 0.
bool drive_port_read_encoders(uint32_t *motor_raw, uint32_t *coarse_raw);

/// Once a tick: where the position is not known, asks both encoders again. True when both have answered.
bool drive_port_search(uint32_t *motor_raw, uint32_t *coarse_raw);

/// Starts the current loop on a drive, which stays with the interrupt from now on.
void drive_port_start(crux_drive *drive, const calibration *zeros);

/// Once a tick: reads supply and winding temperature in turn. False when the current loop has not run for two
/// ticks: then nothing of the drive is measured any more.
bool drive_port_tick(void);

/// Of the winding [degC]; not a number: the thermistor is open or shorted, or has not been read yet.
float drive_port_temperature_degC(void);

/// Whether the gate driver has stopped the bridge within the last 0.1 s (drive_port_tick).
bool drive_port_driver_fault(void);

/// For the fault handler: duties of a standing field, which the timer keeps without the processor.
void drive_port_stand(void);

#endif
