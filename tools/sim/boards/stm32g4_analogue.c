/// Timers and converters: PWM, the trigger it gives, what is converted then and on demand.
#include "stm32g4_internal.h"

// Registers by word, bits.
enum {
  TIM_CR1 = 0x00 / 4,
  TIM_CR2 = 0x04 / 4,
  TIM_SR = 0x10 / 4,
  TIM_EGR = 0x14 / 4,
  TIM_CCER = 0x20 / 4,

  TIM_PSC = 0x28 / 4,
  TIM_ARR = 0x2C / 4,
  TIM_RCR = 0x30 / 4,
  TIM_CCR1 = 0x34 / 4,
  TIM_BDTR = 0x44 / 4
};
enum {
  ADC_ISR = 0x00 / 4,
  ADC_IER = 0x04 / 4,
  ADC_CR = 0x08 / 4,
  ADC_SQR1 = 0x30 / 4,
  ADC_DR = 0x40 / 4,
  ADC_JSQR = 0x4C / 4,
  ADC_JDR1 = 0x80 / 4
};

#define TIM_CR1_CEN (1U << 0U)
#define TIM_CR1_CMS (3U << 5U)
#define TIM_SR_BIF (1U << 7U)
#define TIM_BDTR_BKE (1U << 12U)
#define TIM_BDTR_AOE (1U << 14U)
#define TIM_BDTR_MOE (1U << 15U)
#define TIM_CR2_MMS2_UPDATE 2U
#define ADC_ADRDY (1U << 0U)
#define ADC_EOC (1U << 2U)
#define ADC_JEOC (1U << 5U)
#define ADC_JEOS (1U << 6U)
#define ADC_CR_ADEN (1U << 0U)
#define ADC_CR_ADSTART (1U << 2U)
#define ADC_CR_JADSTART (1U << 3U)
#define ADC_CR_ADVREGEN (1U << 28U)
#define ADC_CR_ADCAL (1U << 31U)
#define ADC_JEXTSEL_TIM1_TRGO2 8U

static void convert_injected(stm32g4 *chip) {
  for (unsigned i = 0U; i < 2U; i++) {
    uint32_t *registers = chip->adc[i].registers;
    const uint32_t sequence = registers[ADC_JSQR];
    const bool armed = (registers[ADC_CR] & (ADC_CR_ADEN | ADC_CR_JADSTART)) == (ADC_CR_ADEN | ADC_CR_JADSTART);
    if (armed && (((sequence >> 2U) & 0x1FU) == ADC_JEXTSEL_TIM1_TRGO2) && (((sequence >> 7U) & 3U) != 0U)) {
      registers[ADC_JDR1] = chip->board.analogue(chip->board.context, i + 1U, (sequence >> 9U) & 0x1FU);
      registers[ADC_ISR] |= ADC_JEOC | ADC_JEOS;
    }
  }
}

static bool is_centred(const stm32g4 *chip) { return (chip->timer1[TIM_CR1] & TIM_CR1_CMS) != 0U; }

/// Until the next update: overflows, or turning points, as many as the repetition counter held at the last one (RM0440
/// 29.3: it is reloaded from RCR at an update, by UG too, and then only).
static uint64_t update_period(const stm32g4 *chip) {
  const uint32_t *timer = chip->timer1;
  const uint64_t reload = timer[TIM_ARR] & 0xFFFFU;
  const uint64_t counts = is_centred(chip) ? reload : reload + 1U;
  return counts * ((timer[TIM_PSC] & 0xFFFFU) + 1U) * (chip->repetitions + 1U);
}

static void reload_repetitions(stm32g4 *chip) { chip->repetitions = chip->timer1[TIM_RCR] & 0xFFFFU; }

/// The counter starts at 0, upwards: it turns at the top first, then at the bottom.
static void turn(stm32g4 *chip) {
  chip->at_top = !is_centred(chip) || (chip->at_top == ((chip->repetitions % 2U) != 0U));
}

/// Nobody needs to hear of the PWM periods of a timer that triggers nothing.
static bool triggers(const stm32g4 *chip) {
  const uint32_t *timer = chip->timer1;
  return ((timer[TIM_CR1] & TIM_CR1_CEN) != 0U) && (((timer[TIM_CR2] >> 20U) & 0xFU) == TIM_CR2_MMS2_UPDATE) &&
         (update_period(chip) > 0U);
}

/// Share of the acting period in which a phase's upper switch is on; while the outputs are off all lower ones are.
static double duty(const stm32g4 *chip, unsigned channel) {
  const uint32_t *timer = chip->timer1;
  const bool on = ((timer[TIM_BDTR] & TIM_BDTR_MOE) != 0U) && (((timer[TIM_CCER] >> (4U * channel)) & 1U) != 0U);
  const double top = (double)(timer[TIM_ARR] & 0xFFFFU) + (((timer[TIM_CR1] & TIM_CR1_CMS) != 0U) ? 0.0 : 1.0);
  const double share = (double)chip->compare[channel] / top;
  return on ? ((share < 1.0) ? share : 1.0) : 0.0;
}

static void break_outputs(stm32g4 *chip) {
  if (chip->break_pulled && ((chip->timer1[TIM_BDTR] & TIM_BDTR_BKE) != 0U)) {
    chip->timer1[TIM_BDTR] &= ~TIM_BDTR_MOE;
    chip->timer1[TIM_SR] |= TIM_SR_BIF;
  }
}

void stm32g4_break(stm32g4 *chip, bool pulled) {
  chip->break_pulled = pulled;
  break_outputs(chip);
}

void stm32g4_update_timer(stm32g4 *chip) {
  const double duties[3] = {duty(chip, 0U), duty(chip, 1U), duty(chip, 2U)};
  chip->board.pwm_period(chip->board.context, chip->update_at, duties);
  for (unsigned i = 0U; i < 3U; i++) {
    chip->compare[i] = chip->timer1[TIM_CCR1 + i];
  }
  chip->timer1[TIM_BDTR] |= ((chip->timer1[TIM_BDTR] & TIM_BDTR_AOE) != 0U) ? TIM_BDTR_MOE : 0U;
  break_outputs(chip);
  turn(chip);
  convert_injected(chip);
  reload_repetitions(chip);
  chip->update_at += update_period(chip);
}

bool stm32g4_lower_conducts(const stm32g4 *chip, unsigned phase) {
  const uint32_t *timer = chip->timer1;
  const uint32_t count = chip->at_top ? (timer[TIM_ARR] & 0xFFFFU) : 0U;
  return ((timer[TIM_BDTR] & TIM_BDTR_MOE) == 0U) || (count >= chip->compare[phase]);  // PWM mode 1
}

void stm32g4_write_timer1(stm32g4 *chip, uint32_t word, uint32_t value) {
  chip->timer1[word] = (word == TIM_SR) ? (chip->timer1[word] & value) : value;
  break_outputs(chip);
  if ((word == TIM_EGR) && ((value & 1U) != 0U)) {
    chip->at_top = false;  // back to 0
    reload_repetitions(chip);
  }
  if ((word == TIM_CR1) || (word == TIM_CR2) || (word == TIM_ARR)) {
    if (!triggers(chip)) {
      chip->update_at = NEVER;
    } else if (chip->update_at == NEVER) {
      chip->update_at = chip->core.now + update_period(chip);
      chip->board.pwm_start(chip->board.context, chip->core.now);
    } else {
      // runs on
    }
  }
  if (chip->update_at == NEVER) {
    for (unsigned i = 0U; i < 3U; i++) {
      chip->compare[i] = chip->timer1[TIM_CCR1 + i];
    }
  }
}

uint32_t stm32g4_read_adc(stm32g4 *chip, uint32_t word) {
  if (word >= 0x300U / 4U) {
    return chip->adc_common[word - (0x300U / 4U)];
  }
  uint32_t *registers = chip->adc[(word / 64U) % 2U].registers;
  const uint32_t which = word % 64U;
  if (which == ADC_DR) {
    registers[ADC_ISR] &= ~ADC_EOC;
  } else if (which == ADC_JDR1) {
    registers[ADC_ISR] &= ~ADC_JEOC;
  } else {
    // without effect
  }
  return registers[which];
}

void stm32g4_write_adc(stm32g4 *chip, uint32_t word, uint32_t value) {
  if (word >= 0x300U / 4U) {
    chip->adc_common[word - (0x300U / 4U)] = value;
    return;
  }
  const unsigned number = (word / 64U) % 2U;
  uint32_t *registers = chip->adc[number].registers;
  const uint32_t which = word % 64U;
  if (which == ADC_ISR) {
    registers[ADC_ISR] &= ~value;
  } else if (which == ADC_CR) {
    // Start, enable and calibrate bits are set by writing one; writing zero leaves them.
    registers[ADC_CR] |= value;
    registers[ADC_CR] &= ~ADC_CR_ADCAL;
    if ((registers[ADC_CR] & (ADC_CR_ADEN | ADC_CR_ADVREGEN)) == (ADC_CR_ADEN | ADC_CR_ADVREGEN)) {
      registers[ADC_ISR] |= ADC_ADRDY;
    }
    if ((registers[ADC_CR] & (ADC_CR_ADEN | ADC_CR_ADSTART)) == (ADC_CR_ADEN | ADC_CR_ADSTART)) {
      registers[ADC_DR] = chip->board.analogue(chip->board.context, number + 1U, (registers[ADC_SQR1] >> 6U) & 0x1FU);
      registers[ADC_ISR] |= ADC_EOC;
      registers[ADC_CR] &= ~ADC_CR_ADSTART;
    }
  } else {
    registers[which] = value;
  }
}

bool stm32g4_converted(const stm32g4 *chip) {
  const uint32_t *first = chip->adc[0].registers;
  const uint32_t *second = chip->adc[1].registers;
  return ((first[ADC_ISR] & first[ADC_IER]) | (second[ADC_ISR] & second[ADC_IER])) != 0U;
}
