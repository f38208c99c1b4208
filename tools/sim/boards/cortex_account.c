#include "cortex_account.h"

#include <string.h>

#include "cortex_cycles.h"

#define WORD_BYTES 8U
#define LINE_WORDS 4U
#define FLASH_WAITS 4U
#define FIRST_OF_TWO_HALVES 0xE800U

void cortex_forget(cortex_fetch *fetch) { *fetch = (cortex_fetch){0}; }

/// Puts a word into the cache, its line first; true when it was there.
static bool hold(cortex_fetch *fetch, uint32_t word) {
  const uint32_t line = (word / LINE_WORDS) + 1U;
  const uint8_t bit = (uint8_t)(1U << (word % LINE_WORDS));
  uint32_t at = 0U;
  while ((at < CORTEX_CACHE_LINES - 1U) && (fetch->line[at] != line)) {
    at++;
  }
  const uint8_t before = (fetch->line[at] == line) ? fetch->words[at] : 0U;
  (void)memmove(&fetch->line[1], &fetch->line[0], at * sizeof(fetch->line[0]));
  (void)memmove(&fetch->words[1], &fetch->words[0], at * sizeof(fetch->words[0]));
  fetch->line[0] = line;
  fetch->words[0] = before | bit;
  return (before & bit) != 0U;
}

/// Waits for the word with the number, at most.
static uint32_t fetch_word(cortex_fetch *fetch, uint32_t word) {
  uint32_t waits = 0U;
  if (fetch->word == word + 1U) {
    return waits;
  }
  const bool found = hold(fetch, word);
  if (!found) {
    const bool prefetched = fetch->waited && (fetch->word == word);
    const uint32_t saved = (fetch->cycles < FLASH_WAITS) ? fetch->cycles : FLASH_WAITS;
    waits = FLASH_WAITS - (prefetched ? saved : 0U);
  }
  fetch->word = word + 1U;
  fetch->waited = !found;
  fetch->cycles = 0U;
  return waits;
}

static uint32_t load_literal(cortex_fetch *fetch, uint32_t word) {
  for (uint32_t i = 0U; i < CORTEX_LITERALS; i++) {
    if (fetch->literal[i] == word + 1U) {
      return 0U;
    }
  }
  fetch->literal[fetch->literals % CORTEX_LITERALS] = word + 1U;
  fetch->literals++;
  return FLASH_WAITS;
}

static uint16_t half_word(const uint8_t *flash, uint32_t offset) {
  uint16_t value;
  (void)memcpy(&value, flash + offset, sizeof(value));
  return value;
}

/// Now it is known whether the branch before was taken.
static void settle_branch(const cortex_fetch *fetch, cortex_count *count, uint32_t offset) {
  if (fetch->may_branch && (fetch->end != offset)) {
    count->least_cycles += CORTEX_REFILL_LEAST;
    count->most_cycles += CORTEX_REFILL_MOST;
  }
}

void cortex_account(cortex_fetch *fetch, cortex_count *count, const uint8_t *flash, uint32_t offset, uint32_t bytes) {
  uint32_t skippable = 0U;
  settle_branch(fetch, count, offset);
  for (uint32_t at = offset; at < offset + bytes;) {
    const uint16_t first = half_word(flash, at);
    const bool two = first >= FIRST_OF_TWO_HALVES;
    const uint16_t second = two ? half_word(flash, at + 2U) : 0U;
    const cortex_cycles cycles = cortex_cycles_of(first, second);
    const uint32_t least = ((skippable > 0U) && (cycles.least > 1U)) ? 1U : cycles.least;
    count->most_cycles += cycles.most + fetch_word(fetch, at / WORD_BYTES);
    if (two) {
      count->most_cycles += fetch_word(fetch, (at + 2U) / WORD_BYTES);
    }
    const uint32_t literal = cortex_literal(first, second, at);
    count->most_cycles += (literal > 0U) ? load_literal(fetch, literal / WORD_BYTES) : 0U;
    count->most_cycles += cortex_uses_float(first, second, fetch->result) ? 1U : 0U;
    fetch->result = cortex_float_result(first, second);
    count->least_cycles += least;
    fetch->cycles += cycles.most;
    fetch->may_branch = cortex_may_branch(first, second);
    skippable = (skippable > 0U) ? (skippable - 1U) : cortex_conditional(first);
    at += two ? 4U : 2U;
  }
  fetch->end = offset + bytes;
}
