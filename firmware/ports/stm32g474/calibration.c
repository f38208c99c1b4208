#include "calibration.h"

#define WORDS 6U

/// Words of the page: magic, electrical offset, rotor zero, coarse zero, zeros of phases a and b, and the complement of
/// the sum of these six.
bool calibration_read(calibration *read) {
  const volatile uint32_t *page = (const volatile uint32_t *)CALIBRATION_ADDRESS;
  uint32_t sum = 0U;
  for (uint32_t i = 0U; i < WORDS; i++) {
    sum += page[i];
  }
  const bool whole = (page[0] == CALIBRATION_MAGIC) && (page[WORDS] == ~sum);
  if (whole) {
    read->mounting.electrical_offset_counts = page[1];
    read->mounting.rotor_zero_counts = page[2];
    read->mounting.coarse_zero_counts = page[3];
    read->phase_a_zero_counts = (float)page[4];
    read->phase_b_zero_counts = (float)page[5];
  }
  return whole;
}
