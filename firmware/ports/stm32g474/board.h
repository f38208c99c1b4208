/// Board of a node: one STM32G474 with a 24 MHz crystal, a three-phase bridge with its gate driver, two magnetic
/// encoders AS5047P on one SPI, and the pins below. Values of the board, not of a robot.
///   PA0, PA1          currents of phases a and b, shunts under their lower switches, by amplifiers of 0.1 V/A about
///                     1.65 V (ADC1 input 1, ADC2 input 2)
///   PA2, PA3          supply over 11, winding's thermistor (ADC1 inputs 3, 4)
///   PA4, PA15         selects of the motor's encoder and of the coarse one behind gear or screw
///   PA5, PA6, PA7     SPI1 clock, in, out
///   PA8..PA10         bridge, upper switches of phases a, b, c (TIM1)
///   PA11, PA12        FDCAN1 receive, transmit
///   PB5, PB6          FDCAN2 receive, transmit: force/torque sensor of a gripper
///   PB12              fault of the gate driver, low: overcurrent, undervoltage (TIM1 break)
///   PB13..PB15        bridge, lower switches
///   PC0..PC2, PC5     straps: node number 1..6 or 8 of a joint; PC3, PC4: limb 0..3
#ifndef CRUX_STM32G474_BOARD_H
#define CRUX_STM32G474_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#define BOARD_CORE_HZ 170000000UL
#define BOARD_TICK_HZ 1000UL
#define BOARD_TICK_US (1000000UL / BOARD_TICK_HZ)
#define BOARD_TICK_S (1.0F / (float)BOARD_TICK_HZ)

#define BOARD_PIN_MOTOR_ENCODER 4UL
#define BOARD_PIN_COARSE_ENCODER 15UL

/// Clocks, pins, SysTick.
void board_init(void);

/// At least that many core cycles.
void board_spend(uint32_t cycles);

/// Node number and limb that the straps say.
uint8_t board_strapped_node(void);
uint8_t board_strapped_limb(void);

/// Resets the chip: the bridge opens, the image starts anew.
_Noreturn void board_restart(void);

/// For an image on trial: unless it feeds the watchdog every half second the chip restarts, and after three tries the
/// other slot's image runs. Once started it runs until the next restart.
void board_start_watchdog(void);

/// The main loop is alive. `kept`: the image has confirmed itself; should it hang from now on the chip must not
/// restart, for that opens the bridge, but let the field stand: the tick's interrupt and the fault handler feed.
void board_feed_watchdog(bool kept);

/// Feeds for an image that is kept.
void board_stay_awake(void);

/// What an image does where the processor fails: each its own.
void fault_handler(void);

/// Waits for the next interrupt; true once for each tick that has passed.
bool board_wait_for_tick(void);

/// True when ticks have passed that nobody has waited for yet: they come at once.
bool board_is_behind(void);

#endif
