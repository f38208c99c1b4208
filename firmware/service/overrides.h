/// Values of a node's parameters that differ from the robot description: written over the bus, kept in the store, and
/// in the node's own struct from the write or from the next start on, as the table says.
#ifndef CRUX_FIRMWARE_OVERRIDES_H
#define CRUX_FIRMWARE_OVERRIDES_H

#include <stdbool.h>
#include <stdint.h>

#include "crux_parameters.h"
#include "store.h"

typedef struct crux_overrides {
  const crux_parameter *table;
  uint8_t count;
  void *parameters;                          ///< the node's struct
  const crux_store *store;                   ///< NULL: nothing can be saved
  uint32_t described[CRUX_MOST_PARAMETERS];  ///< bits of the description's values
  uint32_t set[CRUX_MOST_PARAMETERS];        ///< bits of the values in force, at the latest from the next start on
} crux_overrides;

/// Takes the description's values out of `parameters` and puts into it what the store holds for them, before the node
/// is started with it. What the description does not allow (it may have changed) is left out.
void crux_overrides_init(crux_overrides *overrides, const crux_parameter *table, uint8_t count, void *parameters,
                         const crux_store *store);

/// Index of the parameter with this number, or `count`.
uint8_t crux_overrides_find(const crux_overrides *overrides, uint8_t id);

/// Sets a value that crux_parameter_accepts: in the node's struct at once where the table says so.
void crux_overrides_set(crux_overrides *overrides, uint8_t index, uint32_t bits);

/// Back to the description's values.
void crux_overrides_clear(crux_overrides *overrides);

/// Saves what differs from the description; false when there is no store or it fails.
bool crux_overrides_save(const crux_overrides *overrides);

#endif
