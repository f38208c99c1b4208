#include "board.h"

#include "registers.h"

/// SysTick after the current loop and the bus: it only counts, and a count that waits is not lost.
#define SYSTICK_PRIORITY 0x20UL

/// Of the watchdog, in its ticks of 1 ms (0.94..1.09 ms, says the data sheet).
#define WATCHDOG_TICKS 500UL

static volatile uint32_t ticks_passed;
static volatile bool may_hang;
static uint32_t ticks_seen;

void board_on_systick(void);

void board_on_systick(void) {
  ticks_passed++;
  board_stay_awake();
}

void board_spend(uint32_t cycles) {
  for (uint32_t i = 0U; i < cycles; i++) {
    __asm volatile("nop");
  }
}

static void set_up_clocks(void) {
  RCC_APB1ENR1 |= RCC_APB1ENR1_PWR;
  RCC_CR |= RCC_CR_HSEON;
  while ((RCC_CR & RCC_CR_HSERDY) == 0U) {
  }
  PWR_CR5 &= ~PWR_CR5_R1MODE;  // boost: needed above 150 MHz
  FLASH_ACR = (FLASH_ACR & ~FLASH_ACR_LATENCY_MASK) | 4UL | FLASH_ACR_PREFETCH | FLASH_ACR_ICACHE | FLASH_ACR_DCACHE;
  if ((RCC_CFGR & RCC_CFGR_SWS_MASK) != RCC_CFGR_SWS_PLL) {  // else the boot stage has done it
    // 24 MHz / 6 * 85 / 2 = 170 MHz
    RCC_PLLCFGR = RCC_PLLCFGR_SRC_HSE | RCC_PLLCFGR_M(6UL) | RCC_PLLCFGR_N(85UL) | RCC_PLLCFGR_REN;
    RCC_CR |= RCC_CR_PLLON;
    while ((RCC_CR & RCC_CR_PLLRDY) == 0U) {
    }
    // Half speed for the first microsecond after the switch, as the manual asks.
    RCC_CFGR = (RCC_CFGR & ~RCC_CFGR_HPRE_MASK) | RCC_CFGR_HPRE_DIV2 | RCC_CFGR_SW_PLL;
    while ((RCC_CFGR & RCC_CFGR_SWS_MASK) != RCC_CFGR_SWS_PLL) {
    }
    board_spend(100U);
    RCC_CFGR &= ~RCC_CFGR_HPRE_MASK;
  }
  RCC_CCIPR |= RCC_CCIPR_FDCAN_PCLK1;
  RCC_AHB2ENR |= RCC_AHB2ENR_GPIOA | RCC_AHB2ENR_GPIOB | RCC_AHB2ENR_GPIOC | RCC_AHB2ENR_ADC12;
  RCC_APB1ENR1 |= RCC_APB1ENR1_FDCAN;
  RCC_APB2ENR |= RCC_APB2ENR_TIM1 | RCC_APB2ENR_SPI1;
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

static void pull(uint32_t port, uint32_t pin, uint32_t direction) {
  GPIO_PUPDR(port) = (GPIO_PUPDR(port) & ~(3UL << (2UL * pin))) | (direction << (2UL * pin));
}

static const struct {
  uint32_t port;
  uint32_t pin;
  uint32_t function;
} alternates[] = {
    {GPIOA, 5UL, 5UL},   // SPI1_SCK
    {GPIOA, 6UL, 5UL},   // SPI1_MISO
    {GPIOA, 7UL, 5UL},   // SPI1_MOSI
    {GPIOA, 8UL, 6UL},   // TIM1_CH1
    {GPIOA, 9UL, 6UL},   // TIM1_CH2
    {GPIOA, 10UL, 6UL},  // TIM1_CH3
    {GPIOA, 11UL, 9UL},  // FDCAN1_RX
    {GPIOA, 12UL, 9UL},  // FDCAN1_TX
    {GPIOB, 5UL, 9UL},   // FDCAN2_RX
    {GPIOB, 6UL, 9UL},   // FDCAN2_TX
    {GPIOB, 12UL, 6UL},  // TIM1_BKIN
    {GPIOB, 13UL, 6UL},  // TIM1_CH1N
    {GPIOB, 14UL, 6UL},  // TIM1_CH2N
    {GPIOB, 15UL, 4UL},  // TIM1_CH3N
};

static void set_up_pins(void) {
  for (uint32_t pin = 0UL; pin < 4UL; pin++) {
    set_mode(GPIOA, pin, GPIO_MODE_ANALOG);  // phase currents, supply, thermistor
  }
  GPIO_BSRR(GPIOA) = BIT(BOARD_PIN_MOTOR_ENCODER) | BIT(BOARD_PIN_COARSE_ENCODER);  // not selected
  set_mode(GPIOA, BOARD_PIN_MOTOR_ENCODER, GPIO_MODE_OUTPUT);
  set_mode(GPIOA, BOARD_PIN_COARSE_ENCODER, GPIO_MODE_OUTPUT);
  pull(GPIOB, 12UL, GPIO_PULL_UP);  // the gate driver's fault: open drain
  for (uint32_t i = 0UL; i < (sizeof(alternates) / sizeof(alternates[0])); i++) {
    set_alternate(alternates[i].port, alternates[i].pin, alternates[i].function);
  }
  for (uint32_t pin = 0UL; pin < 6UL; pin++) {
    pull(GPIOC, pin, GPIO_PULL_DOWN);  // an open strap reads 0
    set_mode(GPIOC, pin, GPIO_MODE_INPUT);
  }
}

void board_init(void) {
  set_up_clocks();
  set_up_pins();
  SCB_SHPR3 = SYSTICK_PRIORITY << 24;
  SYST_RVR = (BOARD_CORE_HZ / BOARD_TICK_HZ) - 1UL;
  SYST_CVR = 0UL;
  SYST_CSR = 7UL;  // core clock, interrupt, on
}

uint8_t board_strapped_node(void) {
  const uint32_t straps = GPIO_IDR(GPIOC);
  return (uint8_t)((straps & 7UL) | ((straps >> 2UL) & 8UL));
}

uint8_t board_strapped_limb(void) { return (uint8_t)((GPIO_IDR(GPIOC) >> 3UL) & 3UL); }

_Noreturn void board_restart(void) {
  __asm volatile("dsb" ::: "memory");
  SCB_AIRCR = SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ;
  __asm volatile("dsb" ::: "memory");
  for (;;) {
  }
}

void board_start_watchdog(void) {
  IWDG_KR = IWDG_KR_START;
  IWDG_KR = IWDG_KR_UNLOCK;
  IWDG_PR = IWDG_PR_32;
  IWDG_RLR = WATCHDOG_TICKS;
  while (IWDG_SR != 0U) {
  }
  IWDG_KR = IWDG_KR_RELOAD;
}

void board_feed_watchdog(bool kept) {
  may_hang = kept;
  IWDG_KR = IWDG_KR_RELOAD;
}

void board_stay_awake(void) {
  if (may_hang) {
    IWDG_KR = IWDG_KR_RELOAD;
  }
}

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

bool board_is_behind(void) { return ticks_passed != ticks_seen; }
