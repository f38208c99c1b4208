#include "stm32g4.h"

#include <stddef.h>
#include <string.h>

#include "stm32g4_internal.h"

#define HSI_HZ 16000000U
#define CRYSTAL_START_CYCLES 340000U  // 2 ms at 170 MHz, as cycles are counted here

// Interrupts.
#define IRQ_ADC1_2 18U
#define IRQ_FDCAN1_LINE0 21U
#define IRQ_FDCAN1_LINE1 22U

// Registers by word, bits.
enum {
  RCC_CR = 0x00 / 4,
  RCC_CFGR = 0x08 / 4,
  RCC_PLLCFGR = 0x0C / 4,
  RCC_AHB1ENR = 0x48 / 4,
  RCC_AHB2ENR = 0x4C / 4,
  RCC_APB1ENR1 = 0x58 / 4,
  RCC_APB2ENR = 0x60 / 4,
  RCC_CCIPR = 0x88 / 4
};
enum { GPIO_MODER = 0x00 / 4, GPIO_IDR = 0x10 / 4, GPIO_ODR = 0x14 / 4, GPIO_BSRR = 0x18 / 4 };
#define GPIO_WORDS 64U
enum { SPI_SR = 0x08 / 4, SPI_DR = 0x0C / 4 };

#define RCC_CR_HSEON (1U << 16U)
#define RCC_CR_PLLON (1U << 24U)
#define SPI_RXNE (1U << 0U)
#define SPI_TXE (1U << 1U)

// --- clocks ---

static uint32_t core_hz(const stm32g4 *chip) {
  const uint32_t pll = chip->rcc[RCC_PLLCFGR];
  if ((chip->rcc[RCC_CFGR] & 3U) != 3U) {
    return HSI_HZ;
  }
  const uint32_t source = ((pll & 3U) == 3U) ? chip->board.crystal_hz : HSI_HZ;
  const uint32_t divisor = ((pll >> 4U) & 0xFU) + 1U;
  const uint32_t output = 2U * (((pll >> 25U) & 3U) + 1U);
  const uint32_t half = ((chip->rcc[RCC_CFGR] >> 4U) & 8U) != 0U ? 2U << ((chip->rcc[RCC_CFGR] >> 4U) & 7U) : 1U;
  return (uint32_t)(((uint64_t)source * ((pll >> 8U) & 0x7FU)) / divisor / output / half);
}

static uint32_t read_clocks(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  const bool swings = (word == RCC_CR) && (chip->crystal_at <= chip->core.now);
  return chip->rcc[word] | (swings ? RCC_CR_HSEON << 1U : 0U);
}

static void write_clocks(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  chip->rcc[word] = value;
  if (word == RCC_CR) {  // the PLL is ready at once, the crystal swings after a while
    chip->rcc[word] &= ~((RCC_CR_HSEON | RCC_CR_PLLON) << 1U);
    chip->rcc[word] |= (value & RCC_CR_PLLON) << 1U;
    if ((value & RCC_CR_HSEON) == 0U) {
      chip->crystal_at = NEVER;
    } else if (chip->crystal_at == NEVER) {
      chip->crystal_at = chip->core.now + CRYSTAL_START_CYCLES;
    } else {
      // on already
    }
  } else if (word == RCC_CFGR) {
    chip->rcc[word] = (value & ~(3U << 2U)) | ((value & 3U) << 2U);
  } else {
    // as written
  }
  const bool from_bus_clock = ((chip->rcc[RCC_CCIPR] >> 24U) & 3U) == 2U;
  for (int i = 0; i < 2; i++) {
    chip->can[i].kernel_hz = from_bus_clock ? core_hz(chip) : 0U;
  }
}

// --- pins and SPI ---

static uint32_t read_port(stm32g4 *chip, uint32_t port, uint32_t offset_words) {
  const uint32_t word = offset_words % GPIO_WORDS;
  if (word != GPIO_IDR) {
    return chip->gpio[port][word];
  }
  return (port == 2U) ? chip->board.straps : chip->gpio[port][GPIO_ODR];
}

static void write_port(stm32g4 *chip, uint32_t port, uint32_t offset_words, uint32_t value) {
  const uint32_t word = offset_words % GPIO_WORDS;
  uint32_t *registers = chip->gpio[port];
  const uint32_t before = registers[GPIO_ODR];
  if (word == GPIO_BSRR) {
    registers[GPIO_ODR] = (before & ~(value >> 16U)) | (value & 0xFFFFU);
  } else {
    registers[word] = value;
  }
  if ((port == 0U) && (registers[GPIO_ODR] != before)) {
    chip->board.pins(chip->board.context, before, registers[GPIO_ODR]);
  }
}

static uint32_t read_spi(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  if (word == SPI_DR) {
    chip->spi1[SPI_SR] &= ~SPI_RXNE;
  }
  return chip->spi1[word];
}

static void write_spi(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  if (word == SPI_DR) {
    chip->spi1[SPI_DR] = chip->board.transfer(chip->board.context, (uint16_t)value);
    chip->spi1[SPI_SR] |= SPI_RXNE;
  } else if (word != SPI_SR) {
    chip->spi1[word] = value;
  } else {
    // read-only
  }
}

// --- the chip as the core sees it ---

void stm32g4_settle(stm32g4 *chip) {
  cortex_m4 *core = &chip->core;
  uint64_t next = (chip->watchdog_at < chip->update_at) ? chip->watchdog_at : chip->update_at;
  for (int i = 0; i < 2; i++) {
    const uint64_t can_next = fdcan_model_next(&chip->can[i]);
    next = (can_next < next) ? can_next : next;
  }
  cortex_request(core, IRQ_FDCAN1_LINE0, fdcan_model_line(&chip->can[0], 0U));
  cortex_request(core, IRQ_FDCAN1_LINE1, fdcan_model_line(&chip->can[0], 1U));
  cortex_request(core, IRQ_ADC1_2, stm32g4_converted(chip));
  cortex_wake_at(core, next);
}

static void on_time(void *context) {
  stm32g4 *chip = context;
  const uint64_t now = chip->core.now;
  while (chip->update_at <= now) {
    stm32g4_update_timer(chip);
  }
  for (int i = 0; i < 2; i++) {
    fdcan_model_advance(&chip->can[i], now);
  }
  if (chip->watchdog_at <= now) {
    chip->watchdog_at = NEVER;
    chip->core.wants_reset = true;
  }
  stm32g4_settle(chip);
}

// --- the registers: a row for each peripheral ---

static uint32_t read_converters(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  const uint32_t value = stm32g4_read_adc(chip, word);
  stm32g4_settle(chip);
  return value;
}

static void write_converters(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  stm32g4_write_adc(chip, word, value);
  stm32g4_settle(chip);
}

static uint32_t read_timer(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  return chip->timer1[word];
}

static void write_timer(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  stm32g4_write_timer1(chip, word, value);
  stm32g4_settle(chip);
}

static uint32_t read_can(stm32g4 *chip, uint32_t which, uint32_t word) {
  return fdcan_model_read(&chip->can[which], 4U * word);
}

static void write_can(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  fdcan_model_write(&chip->can[which], chip->core.now, 4U * word, value);
  stm32g4_settle(chip);
}

static uint32_t read_can_ram(stm32g4 *chip, uint32_t which, uint32_t word) { return chip->can[which].ram[word]; }

static void write_can_ram(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  chip->can[which].ram[word] = value;
}

static uint32_t read_power(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  return chip->pwr[word];
}

static void write_power(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  chip->pwr[word] = value;
}

static uint32_t read_flash(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  return stm32g4_read_flash(chip, word);
}

static void write_flash(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  stm32g4_write_flash(chip, word, value);
}

static uint32_t read_watchdog(stm32g4 *chip, uint32_t which, uint32_t word) {
  (void)which;
  return stm32g4_read_watchdog(chip, word);
}

static void write_watchdog(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value) {
  (void)which;
  stm32g4_write_watchdog(chip, word, value);
  stm32g4_settle(chip);
}

typedef struct peripheral {
  uint32_t start;  ///< from 0x40000000
  uint32_t bytes;
  uint32_t gate;  ///< word of the RCC that holds the clock's gate, or ALWAYS_ON
  uint32_t bit;
  uint32_t which;  ///< of its kind
  uint32_t (*read)(stm32g4 *chip, uint32_t which, uint32_t word);
  void (*write)(stm32g4 *chip, uint32_t which, uint32_t word, uint32_t value);
} peripheral;

#define ALWAYS_ON UINT32_MAX

/// Often used ones first.
static const peripheral peripherals[] = {
    {0x10000000U, 0x400U, RCC_AHB2ENR, 13U, 0U, read_converters, write_converters},
    {0x00012C00U, 0x100U, RCC_APB2ENR, 11U, 0U, read_timer, write_timer},
    {0x08000000U, 0x400U, RCC_AHB2ENR, 0U, 0U, read_port, write_port},
    {0x08000400U, 0x400U, RCC_AHB2ENR, 1U, 1U, read_port, write_port},
    {0x08000800U, 0x400U, RCC_AHB2ENR, 2U, 2U, read_port, write_port},
    {0x00013000U, 0x100U, RCC_APB2ENR, 12U, 0U, read_spi, write_spi},
    {0x00006400U, 0x100U, RCC_APB1ENR1, 25U, 0U, read_can, write_can},
    {0x0000A400U, 0x350U, RCC_APB1ENR1, 25U, 0U, read_can_ram, write_can_ram},
    {0x00006800U, 0x100U, RCC_APB1ENR1, 25U, 1U, read_can, write_can},
    {0x0000A750U, 0x350U, RCC_APB1ENR1, 25U, 1U, read_can_ram, write_can_ram},
    {0x00021000U, 0x100U, ALWAYS_ON, 0U, 0U, read_clocks, write_clocks},
    {0x00007000U, 0x100U, RCC_APB1ENR1, 28U, 0U, read_power, write_power},
    {0x00022000U, 0x100U, RCC_AHB1ENR, 8U, 0U, read_flash, write_flash},
    {0x00003000U, 0x10U, ALWAYS_ON, 0U, 0U, read_watchdog, write_watchdog},
};

static const peripheral *find(uint32_t offset) {
  for (size_t i = 0U; i < sizeof(peripherals) / sizeof(peripherals[0]); i++) {
    if (offset - peripherals[i].start < peripherals[i].bytes) {
      return &peripherals[i];
    }
  }
  return NULL;
}

/// Without its clock a peripheral reads zero and takes nothing.
static bool has_clock(const stm32g4 *chip, const peripheral *at) {
  return (at->gate == ALWAYS_ON) || (((chip->rcc[at->gate] >> at->bit) & 1U) != 0U);
}

static bool read_chip(void *context, uint32_t offset, uint32_t *value) {
  stm32g4 *chip = context;
  const peripheral *at = find(offset);
  if (at != NULL) {
    *value = has_clock(chip, at) ? at->read(chip, at->which, (offset - at->start) / 4U) : 0U;
  }
  return at != NULL;
}

static bool write_chip(void *context, uint32_t offset, uint32_t value) {
  stm32g4 *chip = context;
  const peripheral *at = find(offset);
  if ((at != NULL) && has_clock(chip, at)) {
    at->write(chip, at->which, (offset - at->start) / 4U, value);
  }
  return at != NULL;
}

bool stm32g4_pin(const stm32g4 *chip, unsigned pin) { return ((chip->gpio[0][GPIO_ODR] >> pin) & 1U) != 0U; }

static bool program(void *context, uint32_t offset, uint32_t size, uint32_t value) {
  return stm32g4_program_flash(context, offset, size, value);
}

static bool reads(void *context, uint32_t offset, uint32_t size) { return stm32g4_reads_flash(context, offset, size); }

static void restart(void *context) { stm32g4_power_on(context); }

bool stm32g4_open(stm32g4 *chip, const stm32g4_board *board, uint32_t bit_rate, uint32_t data_bit_rate) {
  const cortex_chip around = {.context = chip,
                              .read = read_chip,
                              .write = write_chip,
                              .program = program,
                              .reads = reads,
                              .on_time = on_time,
                              .restart = restart};
  *chip = (stm32g4){
      .board = *board, .bit_rate = bit_rate, .data_bit_rate = data_bit_rate, .update_at = NEVER, .watchdog_at = NEVER};
  const bool opened = cortex_open(&chip->core, &around);
  if (opened) {
    crux_flash_model_init(&chip->flash, chip->core.flash, chip->flash_damaged, CORTEX_FLASH_BYTES);
    chip->flash_access = crux_flash_model_interface(&chip->flash);
  }
  return opened;
}

void stm32g4_close(stm32g4 *chip) {
  cortex_close(&chip->core);
  flash_record_close(&chip->record);
}

/// Everything but core and flash.
static void reset(stm32g4 *chip) {
  (void)memset(chip->rcc, 0, sizeof(chip->rcc));
  (void)memset(chip->pwr, 0, sizeof(chip->pwr));
  stm32g4_reset_flash(chip);
  (void)memset(chip->gpio, 0, sizeof(chip->gpio));
  (void)memset(chip->timer1, 0, sizeof(chip->timer1));
  (void)memset(chip->spi1, 0, sizeof(chip->spi1));
  (void)memset(chip->adc, 0, sizeof(chip->adc));
  (void)memset(chip->adc_common, 0, sizeof(chip->adc_common));
  (void)memset(chip->compare, 0, sizeof(chip->compare));
  (void)memset(chip->watchdog, 0, sizeof(chip->watchdog));
  chip->update_at = NEVER;
  chip->repetitions = 0U;
  chip->at_top = false;
  chip->crystal_at = NEVER;
  chip->watchdog_at = NEVER;
  chip->rcc[RCC_AHB1ENR] = 1U << 8U;
  chip->spi1[SPI_SR] = SPI_TXE;
  fdcan_model_reset(&chip->can[0], chip->bit_rate, chip->data_bit_rate);
  fdcan_model_reset(&chip->can[1], STM32G4_SENSOR_BIT_RATE, 0U);
}

void stm32g4_power_off(stm32g4 *chip) {
  reset(chip);
  cortex_power_off(&chip->core);
}

void stm32g4_power_on(stm32g4 *chip) {
  bool damaged = false;
  for (uint32_t i = 0U; (i < (CORTEX_FLASH_BYTES / CRUX_FLASH_UNIT)) && !damaged; i++) {
    damaged = chip->flash_damaged[i];
  }
  reset(chip);
  chip->flash.off = false;
  cortex_watch_flash(&chip->core, damaged);
  cortex_power_on(&chip->core);
  cortex_wake_at(&chip->core, NEVER);
}
