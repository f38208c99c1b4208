#include "drive_port.h"

#include <math.h>
#include <stddef.h>

#include "board.h"
#include "drive/as5047p.h"
#include "drive/board_watch.h"
#include "registers.h"

#define PWM_HZ 20000UL
#define PWM_TOP (BOARD_CORE_HZ / (2UL * PWM_HZ))  ///< counted up and down
#define DEAD_TIME_CYCLES 85UL                     ///< 0.5 us, more than the switches take
#define BREAK_FILTER 4UL
#define PERIOD_S (1.0F / (float)PWM_HZ)

#define ADC_REGULATOR_CYCLES 4000U  ///< more than the 20 us the ADC's regulator needs
#define ADC_CALIBRATION_CYCLES 40U  ///< more than the 4 ADC clocks between calibration and start
#define ADC_COUNTS 4096.0F
#define ADC_REFERENCE_V 3.3F
#define CHANNEL_PHASE_A 1UL  // of ADC1
#define CHANNEL_PHASE_B 2UL  // of ADC2
#define CHANNEL_SUPPLY 3UL
#define CHANNEL_THERMISTOR 4UL
#define AMPERE_PER_COUNT ((ADC_REFERENCE_V / ADC_COUNTS) / 0.1F)
#define SUPPLY_V_PER_COUNT ((ADC_REFERENCE_V / ADC_COUNTS) * 11.0F)

/// A fault of the gate driver is told so long at least, that a short one shows in a status.
#define DRIVER_FAULT_TICKS (BOARD_TICK_HZ / 10UL)

#define ENCODER_SETTLE_CYCLES 60U  ///< more than the 350 ns between the select's edges and the clock
#define ENCODER_TRIES 600U         ///< more than the 10 ms the sensor needs after power-up: a try takes 22 us

/// The current loop comes first: its duties must be there before the next update.
#define ADC_PRIORITY 0x00UL

// A sample was latched at the start of the interrupt before.
const crux_drive_timing drive_port_timing = {.period_s = PERIOD_S, .encoder_age_s = PERIOD_S};

static crux_drive *controlled;
static float phase_a_zero;
static float phase_b_zero;
static volatile float supply_V;
static float temperature_degC = NAN;
static volatile uint32_t periods;
static crux_loop_watch loop;
static bool supply_is_next;
static uint16_t sent;                ///< command to the motor's encoder that is on its way; 0: none
static uint16_t answered;            ///< the command before, whose answer comes with that frame; 0: none
static uint32_t driver_fault_ticks;  ///< for which a fault of the gate driver is told yet

void drive_port_on_sample(void);

static void select_encoder(uint32_t pin) { GPIO_BSRR(GPIOA) = BIT(pin + 16UL); }

static void release_encoder(uint32_t pin) { GPIO_BSRR(GPIOA) = BIT(pin); }

static uint16_t exchange(uint32_t pin, uint16_t command) {
  select_encoder(pin);
  board_spend(ENCODER_SETTLE_CYCLES);
  SPI1_DR = command;
  while ((SPI1_SR & SPI_SR_RXNE) == 0U) {
  }
  const uint16_t answer = SPI1_DR;
  board_spend(ENCODER_SETTLE_CYCLES);
  release_encoder(pin);
  board_spend(ENCODER_SETTLE_CYCLES);
  return answer;
}

/// Clears the error flag, asks, and takes the answer.
static bool try_encoder(uint32_t pin, uint32_t *raw) {
  (void)exchange(pin, CRUX_AS5047P_READ_ERRORS);
  (void)exchange(pin, CRUX_AS5047P_READ_ANGLE);
  const uint16_t answer = exchange(pin, CRUX_AS5047P_READ_ANGLE);
  const bool valid = crux_as5047p_valid(answer);
  *raw = valid ? crux_as5047p_angle(answer) : 0U;
  return valid;
}

/// A sensor that starts up is asked again.
static bool read_encoder(uint32_t pin, uint32_t *raw) {
  bool valid = false;
  for (uint32_t i = 0U; (i < ENCODER_TRIES) && !valid; i++) {
    valid = try_encoder(pin, raw);
  }
  return valid;
}

bool drive_port_read_encoders(uint32_t *motor_raw, uint32_t *coarse_raw) {
  SPI1_CR2 = SPI_CR2_DS_16;
  SPI1_CR1 = SPI_CR1_CPHA | SPI_CR1_MSTR | SPI_CR1_BR_32 | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_SPE;
  const bool motor = read_encoder(BOARD_PIN_MOTOR_ENCODER, motor_raw);
  const bool coarse = read_encoder(BOARD_PIN_COARSE_ENCODER, coarse_raw);
  return motor && coarse;
}

bool drive_port_search(uint32_t *motor_raw, uint32_t *coarse_raw) {
  bool found = false;
  if (!crux_drive_sees(controlled)) {  // the interrupt keeps off the SPI
    const bool motor = try_encoder(BOARD_PIN_MOTOR_ENCODER, motor_raw);
    const bool coarse = try_encoder(BOARD_PIN_COARSE_ENCODER, coarse_raw);
    if (motor && !controlled->encoder.seen) {
      crux_encoder_restart(&controlled->encoder, *motor_raw);
    }
    found = motor && coarse;
  }
  return found;
}

static void set_up_timer(void) {
  TIM1_ARR = PWM_TOP;
  TIM1_CCMR1 = TIM_CCMR1_OC1PE | TIM_CCMR1_OC1M_PWM1 | TIM_CCMR1_OC2PE | TIM_CCMR1_OC2M_PWM1;
  TIM1_CCMR2 = TIM_CCMR2_OC3PE | TIM_CCMR2_OC3M_PWM1;
  TIM1_CCER = TIM_CCER_CC1E | TIM_CCER_CC1NE | TIM_CCER_CC2E | TIM_CCER_CC2NE | TIM_CCER_CC3E | TIM_CCER_CC3NE;
  // On a break the lower switches close: a motor with shorted phases brakes, an open one is limp. The outputs come back
  // by themselves when the driver's fault has gone.
  TIM1_CR2 = TIM_CR2_OIS1N | TIM_CR2_OIS2N | TIM_CR2_OIS3N | TIM_CR2_MMS2_UPDATE;
  TIM1_CCR1 = PWM_TOP / 2UL;
  TIM1_CCR2 = PWM_TOP / 2UL;
  TIM1_CCR3 = PWM_TOP / 2UL;
  TIM1_EGR = TIM_EGR_UG;
  TIM1_BDTR = TIM_BDTR_DTG(DEAD_TIME_CYCLES) | TIM_BDTR_OSSI | TIM_BDTR_OSSR | TIM_BDTR_BKE | TIM_BDTR_AOE |
              TIM_BDTR_MOE | TIM_BDTR_BKF(BREAK_FILTER);
}

static void set_up_adc(uint32_t adc, uint32_t channel) {
  ADC_CR(adc) = ADC_CR_ADVREGEN;  // also leaves deep power-down
  board_spend(ADC_REGULATOR_CYCLES);
  ADC_CR(adc) = ADC_CR_ADVREGEN | ADC_CR_ADCAL;
  while ((ADC_CR(adc) & ADC_CR_ADCAL) != 0U) {
  }
  board_spend(ADC_CALIBRATION_CYCLES);
  ADC_CR(adc) = ADC_CR_ADVREGEN | ADC_CR_ADEN;
  while ((ADC_ISR(adc) & ADC_ISR_ADRDY) == 0U) {
  }
  ADC_SMPR1(adc) = ADC_SMPR1_SMP(channel, ADC_SAMPLE_12_CYCLES) | ADC_SMPR1_SMP(CHANNEL_SUPPLY, ADC_SAMPLE_247_CYCLES) |
                   ADC_SMPR1_SMP(CHANNEL_THERMISTOR, ADC_SAMPLE_247_CYCLES);
  ADC_JSQR(adc) = ADC_JSQR_JEXTSEL_TIM1_TRGO2 | ADC_JSQR_JEXTEN_RISING | ADC_JSQR_JSQ1(channel);
}

/// A conversion of supply or thermistor in turn, read at the next tick; the currents' conversions go before it.
static void start_slow_conversion(void) {
  supply_is_next = !supply_is_next;
  ADC_SQR1(ADC1) = ADC_SQR1_SQ1(supply_is_next ? CHANNEL_SUPPLY : CHANNEL_THERMISTOR);
  ADC_CR(ADC1) = ADC_CR_ADVREGEN | ADC_CR_ADSTART;
}

void drive_port_start(crux_drive *drive, const calibration *zeros) {
  controlled = drive;
  phase_a_zero = zeros->phase_a_zero_counts;
  phase_b_zero = zeros->phase_b_zero_counts;
  supply_V = drive->motor.supply_V;
  ADC12_CCR = ADC12_CCR_CKMODE_HCLK_4;
  set_up_adc(ADC1, CHANNEL_PHASE_A);
  set_up_adc(ADC2, CHANNEL_PHASE_B);
  set_up_timer();
  if (crux_drive_sees(drive)) {
    (void)exchange(BOARD_PIN_MOTOR_ENCODER, CRUX_AS5047P_READ_ANGLE);
    select_encoder(BOARD_PIN_MOTOR_ENCODER);
    board_spend(ENCODER_SETTLE_CYCLES);
    SPI1_DR = CRUX_AS5047P_READ_ANGLE;
    sent = CRUX_AS5047P_READ_ANGLE;
    answered = CRUX_AS5047P_READ_ANGLE;
  }
  NVIC_IPR4 = ADC_PRIORITY << (8UL * (IRQ_ADC1_2 - 16UL));
  ADC_IER(ADC1) = ADC_IER_JEOCIE;
  ADC_CR(ADC2) = ADC_CR_ADVREGEN | ADC_CR_JADSTART;
  ADC_CR(ADC1) = ADC_CR_ADVREGEN | ADC_CR_JADSTART;
  NVIC_ISER0 = BIT(IRQ_ADC1_2);
  TIM1_CR1 = TIM_CR1_CMS_BOTH | TIM_CR1_CEN;
  // One update in two turning points: at the overflow, where all lower switches conduct. What is written here, on the
  // way up, is loaded at the first overflow; written before the launch it puts the update at the underflow (RM0440
  // 29.3), where none of them does.
  TIM1_RCR = 1UL;
  start_slow_conversion();
}

static uint32_t compare(float duty) {
  const uint32_t top = PWM_TOP;
  return (uint32_t)(duty * (float)top);
}

/// The answer of the frame that has run since the last period, if there was one; of an angle it is a sample.
static uint16_t take_answer(crux_drive_inputs *inputs) {
  uint16_t answer = 0U;
  if (sent != 0U) {
    answer = SPI1_DR;
    release_encoder(BOARD_PIN_MOTOR_ENCODER);
  }
  inputs->encoder_valid = (answered == CRUX_AS5047P_READ_ANGLE) && crux_as5047p_valid(answer);
  inputs->encoder_raw = crux_as5047p_angle(answer);
  return answer;
}

/// An error flag stays until the errors are read: once for each, for the next answer still has it.
static uint16_t next_command(uint16_t answer) {
  const bool flagged = (answered == CRUX_AS5047P_READ_ANGLE) && crux_as5047p_flagged(answer);
  return (uint16_t)((flagged && (sent == CRUX_AS5047P_READ_ANGLE)) ? CRUX_AS5047P_READ_ERRORS
                                                                   : CRUX_AS5047P_READ_ANGLE);
}

void drive_port_on_sample(void) {
  crux_drive *drive = controlled;
  crux_drive_inputs inputs;
  inputs.phase_a_A = ((float)ADC_JDR1(ADC1) - phase_a_zero) * AMPERE_PER_COUNT;  // reading it clears the request
  inputs.phase_b_A = ((float)ADC_JDR1(ADC2) - phase_b_zero) * AMPERE_PER_COUNT;
  const uint16_t answer = take_answer(&inputs);
  inputs.supply_V = supply_V;
  inputs.bridge_stopped = (TIM1_BDTR & TIM_BDTR_MOE) == 0U;
  crux_drive_step(drive, &inputs);
  const uint16_t command = crux_drive_sees(drive) ? next_command(answer) : 0U;
  if (command != 0U) {
    select_encoder(BOARD_PIN_MOTOR_ENCODER);
  }
  TIM1_CCR1 = compare(drive->outputs.duty[0]);
  TIM1_CCR2 = compare(drive->outputs.duty[1]);
  TIM1_CCR3 = compare(drive->outputs.duty[2]);
  periods++;
  answered = sent;
  sent = command;
  if (command != 0U) {
    board_spend(ENCODER_SETTLE_CYCLES / 4U);  // a turn of the loop takes four: add, compare, a branch that is taken
    SPI1_DR = command;
  }
}

/// The timer keeps a break in mind until it is asked, and as long as the driver pulls the line.
static void look_at_driver(void) {
  const bool stopped = (TIM1_SR & TIM_SR_BIF) != 0U;
  if (stopped) {
    TIM1_SR = ~TIM_SR_BIF;
  }
  driver_fault_ticks = crux_fault_ticks(driver_fault_ticks, stopped, DRIVER_FAULT_TICKS);
}

bool drive_port_tick(void) {
  const bool runs = crux_loop_runs(&loop, periods, board_is_behind());
  look_at_driver();
  const float counts = (float)(ADC_DR(ADC1) & 0xFFFFUL);
  if (supply_is_next) {
    supply_V = counts * SUPPLY_V_PER_COUNT;
  } else {
    temperature_degC = crux_thermistor_degC(counts / ADC_COUNTS);
  }
  start_slow_conversion();
  return runs;
}

float drive_port_temperature_degC(void) { return temperature_degC; }

bool drive_port_driver_fault(void) { return driver_fault_ticks > 0U; }

void drive_port_stand(void) {
  if (controlled != NULL) {
    TIM1_CCR1 = compare(controlled->standing_duty[0]);
    TIM1_CCR2 = compare(controlled->standing_duty[1]);
    TIM1_CCR3 = compare(controlled->standing_duty[2]);
  }
}
