/// Board support of the node images: one STM32G474 with a 24 MHz crystal, a motor driver that takes PWM and direction,
/// and the pins below. Values of the board, not of a robot.
///   PA0, PA1    quadrature encoder on the joint's output (TIM2)
///   PA3         potentiometer of the gripper's actuator (ADC1 input 4)
///   PA8, PA9    PWM (TIM1 channel 1) and direction of the motor driver
///   PA11, PA12  FDCAN1 receive, transmit
///   PC0..PC2    straps: node number 1..6 of a joint; PC3, PC4: limb 0..3
#ifndef CRUX_STM32G474_BOARD_H
#define CRUX_STM32G474_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#define BOARD_CORE_HZ 170000000UL
#define BOARD_TICK_HZ 1000UL
#define BOARD_TICK_S (1.0F / (float)BOARD_TICK_HZ)

/// Clocks, pins, timers, ADC, SysTick.
void board_init(void);

/// Node number and limb that the straps say.
uint8_t board_strapped_node(void);
uint8_t board_strapped_limb(void);

/// Waits for the next interrupt; true once for each tick that has passed.
bool board_wait_for_tick(void);

/// Position of the joint [rad], counted from where it stood at power-up.
float board_encoder_position_rad(void);

/// Stroke of the gripper's actuator as a share 0..1 of the potentiometer's travel.
float board_potentiometer_share(void);

/// Temperature of the microcontroller [degC].
float board_temperature_degC(void);

/// Share -1..1 of the greatest torque or force: direction pin and PWM duty of the driver's current reference.
void board_drive(float share);

#endif
