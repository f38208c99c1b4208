#include "overrides.h"

#include <string.h>

#include "permission.h"

static void put(crux_overrides *overrides, uint8_t index) {
  (void)memcpy((uint8_t *)overrides->parameters + (sizeof(uint32_t) * index), &overrides->set[index], sizeof(uint32_t));
}

uint8_t crux_overrides_find(const crux_overrides *overrides, uint8_t id) {
  uint8_t index = 0U;
  while ((index < overrides->count) && (overrides->table[index].id != id)) {
    index++;
  }
  return index;
}

void crux_overrides_init(crux_overrides *overrides, const crux_parameter *table, uint8_t count, void *parameters,
                         const crux_store *store) {
  crux_stored entries[CRUX_STORE_CAPACITY];
  *overrides = (crux_overrides){.table = table, .count = count, .parameters = parameters, .store = store};
  (void)memcpy(overrides->described, parameters, sizeof(uint32_t) * count);
  (void)memcpy(overrides->set, parameters, sizeof(uint32_t) * count);
  const uint8_t stored = (store != NULL) ? crux_store_load(store, entries) : 0U;
  for (uint8_t i = 0U; i < stored; i++) {
    const uint8_t index = crux_overrides_find(overrides, entries[i].id);
    if ((index < count) && crux_parameter_accepts(&table[index], overrides->described[index], entries[i].bits)) {
      overrides->set[index] = entries[i].bits;
      put(overrides, index);
    }
  }
}

void crux_overrides_set(crux_overrides *overrides, uint8_t index, uint32_t bits) {
  overrides->set[index] = bits;
  if (overrides->table[index].acts_now) {
    put(overrides, index);
  }
}

void crux_overrides_clear(crux_overrides *overrides) {
  for (uint8_t i = 0U; i < overrides->count; i++) {
    crux_overrides_set(overrides, i, overrides->described[i]);
  }
}

bool crux_overrides_save(const crux_overrides *overrides) {
  crux_stored entries[CRUX_STORE_CAPACITY];
  uint8_t count = 0U;
  for (uint8_t i = 0U; i < overrides->count; i++) {
    if (overrides->set[i] != overrides->described[i]) {
      entries[count] = (crux_stored){.id = overrides->table[i].id, .bits = overrides->set[i]};
      count++;
    }
  }
  return (overrides->store != NULL) && crux_store_save(overrides->store, entries, count);
}
