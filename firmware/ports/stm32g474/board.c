#include "board.h"

#include "registers.h"

#define PWM_HZ 20000UL
#define ENCODER_COUNTS_PER_TURN 16384.0F
#define TWO_PI 6.28318531F
#define ADC_FULL_SCALE 4095.0F
#define ADC_CHANNEL_POTENTIOMETER 4UL
#define ADC_CHANNEL_TEMPERATURE 16UL
#define ADC_REGULATOR_CYCLES 4000U  ///< more than the 20 us the ADC's regulator needs
#define ADC_CALIBRATION_CYCLES 20U  ///< more than the 4 ADC clocks between calibration and start
#define REFERENCE_V 3.3F            ///< VREF+ of this board
#define CALIBRATION_REFERENCE_V 3.0F
#define CALIBRATION_LOW_DEG_C 30.0F
#define CALIBRATION_HIGH_DEG_C 110.0F

static volatile uint32_t ticks_passed;
static uint32_t ticks_seen;

void board_on_systick(void);

void board_on_systick(void) { ticks_passed++; }

/// At least that many core cycles.
static void spend(uint32_t cycles) {
  for (volatile uint32_t i = 0U; i < cycles; i++) {
  }
}

static void set_up_clocks(void) {
  RCC_APB1ENR1 |= RCC_APB1ENR1_PWR;
  RCC_CR |= RCC_CR_HSEON;
  while ((RCC_CR & RCC_CR_HSERDY) == 0U) {
  }
  PWR_CR5 &= ~PWR_CR5_R1MODE;  // boost: needed above 150 MHz
  FLASH_ACR = (FLASH_ACR & ~FLASH_ACR_LATENCY_MASK) | 4UL | FLASH_ACR_PREFETCH | FLASH_ACR_ICACHE | FLASH_ACR_DCACHE;
  // 24 MHz / 6 * 85 / 2 = 170 MHz
  RCC_PLLCFGR = RCC_PLLCFGR_SRC_HSE | RCC_PLLCFGR_M(6UL) | RCC_PLLCFGR_N(85UL) | RCC_PLLCFGR_REN;
  RCC_CR |= RCC_CR_PLLON;
  while ((RCC_CR & RCC_CR_PLLRDY) == 0U) {
  }
  // Half speed for the first microsecond after the switch, as the manual asks.
  RCC_CFGR = (RCC_CFGR & ~RCC_CFGR_HPRE_MASK) | RCC_CFGR_HPRE_DIV2 | RCC_CFGR_SW_PLL;
  while ((RCC_CFGR & RCC_CFGR_SWS_MASK) != RCC_CFGR_SWS_PLL) {
  }
  spend(100U);
  RCC_CFGR &= ~RCC_CFGR_HPRE_MASK;
  RCC_CCIPR |= RCC_CCIPR_FDCAN_PCLK1;
  RCC_AHB2ENR |= RCC_AHB2ENR_GPIOA | RCC_AHB2ENR_GPIOC | RCC_AHB2ENR_ADC12;
  RCC_APB1ENR1 |= RCC_APB1ENR1_TIM2 | RCC_APB1ENR1_FDCAN;
  RCC_APB2ENR |= RCC_APB2ENR_TIM1;
}

static void set_mode(uint32_t port, uint32_t pin, uint32_t mode) {
  GPIO_MODER(port) = (GPIO_MODER(port) & ~(3UL << (2UL * pin))) | (mode << (2UL * pin));
}

static void set_alternate(uint32_t port, uint32_t pin, uint32_t function) {
  const uint32_t shift = 4UL * (pin % 8UL);
  if (pin < 8UL) {
    GPIO_AFRL(port) = (GPIO_AFRL(port) & ~(0xFUL << shift)) | (function << shift);
  } else {
    GPIO_AFRH(port) = (GPIO_AFRH(port) & ~(0xFUL << shift)) | (function << shift);
  }
  set_mode(port, pin, GPIO_MODE_ALTERNATE);
}

static void set_up_pins(void) {
  set_alternate(GPIOA, 0UL, 1UL);   // TIM2_CH1
  set_alternate(GPIOA, 1UL, 1UL);   // TIM2_CH2
  set_alternate(GPIOA, 8UL, 6UL);   // TIM1_CH1
  set_alternate(GPIOA, 11UL, 9UL);  // FDCAN1_RX
  set_alternate(GPIOA, 12UL, 9UL);  // FDCAN1_TX
  set_mode(GPIOA, 9UL, GPIO_MODE_OUTPUT);
  for (uint32_t pin = 0UL; pin < 5UL; pin++) {
    GPIO_PUPDR(GPIOC) |= 2UL << (2UL * pin);  // pulled down: an open strap reads 0
    set_mode(GPIOC, pin, GPIO_MODE_INPUT);
  }
}

static void set_up_timers(void) {
  TIM_ARR(TIM1) = (BOARD_CORE_HZ / PWM_HZ) - 1UL;
  TIM_CCMR1(TIM1) = TIM_CCMR1_PWM1_PRELOADED;
  TIM_CCER(TIM1) = TIM_CCER_CC1E;
  TIM_BDTR(TIM1) = TIM_BDTR_MOE;
  TIM_EGR(TIM1) = TIM_EGR_UG;
  TIM_CR1(TIM1) = TIM_CR1_CEN;
  TIM_ARR(TIM2) = UINT32_MAX;
  TIM_CCMR1(TIM2) = TIM_CCMR1_INPUTS;
  TIM_SMCR(TIM2) = TIM_SMCR_ENCODER_BOTH;
  TIM_CR1(TIM2) = TIM_CR1_CEN;
}

static void set_up_adc(void) {
  ADC12_CCR = ADC12_CCR_CKMODE_HCLK_4 | ADC12_CCR_VSENSESEL;
  ADC1_CR = ADC_CR_ADVREGEN;  // also leaves deep power-down
  spend(ADC_REGULATOR_CYCLES);
  ADC1_CR |= ADC_CR_ADCAL;
  while ((ADC1_CR & ADC_CR_ADCAL) != 0U) {
  }
  ADC1_SMPR1 = ADC_SAMPLE_640_CYCLES << (3UL * ADC_CHANNEL_POTENTIOMETER);
  ADC1_SMPR2 = ADC_SAMPLE_640_CYCLES << (3UL * (ADC_CHANNEL_TEMPERATURE - 10UL));
  spend(ADC_CALIBRATION_CYCLES);
  ADC1_CR |= ADC_CR_ADEN;
  while ((ADC1_ISR & ADC_ISR_ADRDY) == 0U) {
  }
}

void board_init(void) {
  set_up_clocks();
  set_up_pins();
  set_up_timers();
  set_up_adc();
  SYST_RVR = (BOARD_CORE_HZ / BOARD_TICK_HZ) - 1UL;
  SYST_CVR = 0UL;
  SYST_CSR = 7UL;  // core clock, interrupt, on
}

uint8_t board_strapped_node(void) { return (uint8_t)(GPIO_IDR(GPIOC) & 7UL); }

uint8_t board_strapped_limb(void) { return (uint8_t)((GPIO_IDR(GPIOC) >> 3UL) & 3UL); }

bool board_wait_for_tick(void) {
  // Masked, so that a tick between the look and the sleep still wakes the core.
  __asm volatile("cpsid i" ::: "memory");
  if (ticks_passed == ticks_seen) {
    __asm volatile("wfi" ::: "memory");
  }
  __asm volatile("cpsie i" ::: "memory");
  const bool passed = ticks_passed != ticks_seen;
  ticks_seen += passed ? 1U : 0U;
  return passed;
}

float board_encoder_position_rad(void) { return (float)(int32_t)TIM_CNT(TIM2) * (TWO_PI / ENCODER_COUNTS_PER_TURN); }

/// One conversion, some 15 us.
static float convert(uint32_t channel) {
  ADC1_SQR1 = channel << 6UL;
  ADC1_CR |= ADC_CR_ADSTART;
  while ((ADC1_ISR & ADC_ISR_EOC) == 0U) {
  }
  return (float)(ADC1_DR & 0xFFFFUL);  // reading it clears EOC
}

float board_potentiometer_share(void) { return convert(ADC_CHANNEL_POTENTIOMETER) / ADC_FULL_SCALE; }

float board_temperature_degC(void) {
  const float reading = convert(ADC_CHANNEL_TEMPERATURE) * (REFERENCE_V / CALIBRATION_REFERENCE_V);
  const float low = (float)TS_CAL1;
  const float high = (float)TS_CAL2;
  return CALIBRATION_LOW_DEG_C + ((reading - low) * ((CALIBRATION_HIGH_DEG_C - CALIBRATION_LOW_DEG_C) / (high - low)));
}

void board_drive(float share) {
  const float magnitude = (share < 0.0F) ? -share : share;
  const float duty = (magnitude < 1.0F) ? magnitude : 1.0F;
  GPIO_BSRR(GPIOA) = (share < 0.0F) ? BIT(9) : BIT(9U + 16U);
  TIM_CCR1(TIM1) = (uint32_t)(duty * (float)(BOARD_CORE_HZ / PWM_HZ));
}
