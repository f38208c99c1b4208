#include "cortex_cycles.h"

#include <stdbool.h>

#define DIVISION_LEAST 2U
#define DIVISION_MOST 12U
#define FLOAT_DIVISION 14U
#define BARRIER_MOST 4U
#define PC 15U

static cortex_cycles between(uint32_t least, uint32_t most) { return (cortex_cycles){.least = least, .most = most}; }

static cortex_cycles jump(uint32_t cycles) {
  return between(cycles + CORTEX_REFILL_LEAST, cycles + CORTEX_REFILL_MOST);
}

/// A load of one word or less: what follows may overlap. A store goes to the write buffer.
static cortex_cycles load_or_store(void) { return between(1U, 2U); }

static cortex_cycles several(uint32_t registers, bool to_pc) {
  return to_pc ? jump(1U + registers) : between(1U + registers, 1U + registers);
}

static uint32_t count(uint32_t list) { return (uint32_t)__builtin_popcount(list); }

// --- sixteen bits ---

static cortex_cycles miscellaneous(uint16_t code) {
  if ((code & 0xF500U) == 0xB100U) {  // CBZ, CBNZ
    return between(1U, 1U);
  }
  if ((code & 0xFE00U) == 0xB400U) {  // PUSH
    return several(count(code & 0x1FFU), false);
  }
  if ((code & 0xFE00U) == 0xBC00U) {  // POP
    return several(count(code & 0x1FFU), (code & 0x100U) != 0U);
  }
  if (((code & 0xFF00U) == 0xBF00U) && ((code & 0xFU) != 0U)) {  // IT folds into the instruction before
    return between(0U, 1U);
  }
  return between(1U, 1U);
}

static cortex_cycles high_registers(uint16_t code) {
  const uint32_t target = (code & 7U) | ((code >> 4U) & 8U);
  if ((code & 0x0300U) == 0x0300U) {  // BX, BLX
    return jump(1U);
  }
  return (((code & 0x0300U) != 0x0100U) && (target == PC)) ? jump(1U) : between(1U, 1U);  // CMP has no target
}

static cortex_cycles narrow(uint16_t code) {
  switch (code >> 12U) {
    case 0x4U:
      if ((code & 0xFC00U) == 0x4400U) {
        return high_registers(code);
      }
      return ((code & 0x0800U) != 0U) ? load_or_store() : between(1U, 1U);
    case 0x5U:
    case 0x6U:
    case 0x7U:
    case 0x8U:
    case 0x9U:
      return load_or_store();
    case 0xBU:
      return miscellaneous(code);
    case 0xCU:
      return several(count(code & 0xFFU), false);
    case 0xDU:
      return between(1U, 1U);
    case 0xEU:
      return jump(1U);
    default:
      return between(1U, 1U);
  }
}

// --- twice sixteen bits ---

static cortex_cycles two_registers(uint16_t first, uint16_t second) {
  if (((first & 0xFFF0U) == 0xE8D0U) && ((second & 0xFFE0U) == 0xF000U)) {  // TBB, TBH
    return jump(2U);
  }
  return ((first & 0x0120U) != 0U) ? between(2U, 3U) : between(2U, 2U);  // LDRD, STRD; LDREX, STREX
}

static cortex_cycles load_or_store_multiple(uint16_t first, uint16_t second) {
  const bool load = (first & 0x0010U) != 0U;
  return several(count(second), load && ((second & 0x8000U) != 0U));
}

static cortex_cycles branch_or_control(uint16_t first, uint16_t second) {
  if ((second & 0x5000U) != 0U) {  // B.W, BL
    return jump(1U);
  }
  if ((first & 0x0380U) != 0x0380U) {
    return between(1U, 1U);
  }
  return between(1U, BARRIER_MOST);  // MSR, MRS, hints, barriers
}

static cortex_cycles multiply_or_divide(uint16_t first, uint16_t second) {
  const uint32_t operation = (first >> 4U) & 7U;
  if ((first & 0x0080U) != 0U) {
    return ((operation == 1U) || (operation == 3U)) ? between(DIVISION_LEAST, DIVISION_MOST) : between(1U, 1U);
  }
  const bool accumulates = (second >> 12U) != PC;
  return ((operation == 0U) && accumulates) ? between(2U, 2U) : between(1U, 1U);  // MLA, MLS
}

static cortex_cycles float_arithmetic(uint16_t first, uint16_t second) {
  if ((second & 0x0010U) != 0U) {  // between the register files
    return between(1U, 1U);
  }
  switch (((first >> 5U) & 4U) | ((first >> 4U) & 3U)) {
    case 2U:  // VMUL, VNMUL
    case 3U:  // VADD, VSUB
      return between(1U, 1U);
    case 4U:  // VDIV
      return between(FLOAT_DIVISION, FLOAT_DIVISION);
    case 7U: {
      const bool root = ((first & 0xFU) == 1U) && ((second & 0xC0U) == 0xC0U);
      return root ? between(FLOAT_DIVISION, FLOAT_DIVISION) : between(1U, 1U);  // VSQRT; VMOV, VABS, VNEG, VCMP, VCVT
    }
    default:  // multiply and accumulate, fused or not
      return between(3U, 3U);
  }
}

static cortex_cycles float_memory(uint16_t first, uint16_t second) {
  if ((first & 0x0FE0U) == 0x0C40U) {  // VMOV of two core registers
    return between(2U, 2U);
  }
  const bool one = ((first & 0x0120U) == 0x0100U);  // VLDR, VSTR
  if (!one) {
    return several(second & 0xFFU, false);
  }
  return ((second & 0x0100U) != 0U) ? between(2U, 3U) : between(1U, 2U);
}

static cortex_cycles wide(uint16_t first, uint16_t second) {
  if ((first & 0xFE40U) == 0xE800U) {
    return load_or_store_multiple(first, second);
  }
  if ((first & 0xFE40U) == 0xE840U) {
    return two_registers(first, second);
  }
  if ((first & 0xEF00U) == 0xEE00U) {
    return float_arithmetic(first, second);
  }
  if ((first & 0xEE00U) == 0xEC00U) {
    return float_memory(first, second);
  }
  if ((first & 0xF800U) == 0xF000U) {
    return ((second & 0x8000U) != 0U) ? branch_or_control(first, second) : between(1U, 1U);
  }
  if ((first & 0xFE00U) == 0xF800U) {
    const bool jumps = ((first & 0x0070U) == 0x0050U) && ((second >> 12U) == PC);
    return jumps ? jump(2U) : load_or_store();
  }
  return ((first & 0xFF00U) == 0xFB00U) ? multiply_or_divide(first, second) : between(1U, 1U);
}

cortex_cycles cortex_cycles_of(uint16_t first, uint16_t second) {
  return (first >= 0xE800U) ? wide(first, second) : narrow(first);
}

uint32_t cortex_conditional(uint16_t first) {
  const bool is_it = ((first & 0xFF00U) == 0xBF00U) && ((first & 0xFU) != 0U);
  return is_it ? (4U - (uint32_t)__builtin_ctz(first & 0xFU)) : 0U;
}

uint32_t cortex_literal(uint16_t first, uint16_t second, uint32_t at) {
  const uint32_t base = (at + 4U) & ~3U;
  uint32_t distance = 4U * (uint32_t)(second & 0xFFU);
  if ((first & 0xF800U) == 0x4800U) {
    return base + (4U * (uint32_t)(first & 0xFFU));
  }
  if (((first & 0xFE1FU) == 0xF81FU) && ((second >> 12U) != PC)) {
    distance = second & 0xFFFU;
  } else if (((first & 0xFE5FU) != 0xE85FU) && ((first & 0xFF3FU) != 0xED1FU)) {  // LDRD, VLDR
    return 0U;
  } else {
    // eight bits count words
  }
  return ((first & 0x0080U) != 0U) ? (base + distance) : (base - distance);
}

static bool is_float(uint16_t first) { return (first & 0xEC00U) == 0xEC00U; }

// Registers s0.. by four bits and one.
static uint32_t target(uint16_t first, uint16_t second) { return ((second >> 11U) & 0x1EU) | ((first >> 6U) & 1U); }
static uint32_t left(uint16_t first, uint16_t second) { return ((first & 0xFU) << 1U) | ((second >> 7U) & 1U); }
static uint32_t right(uint16_t second) { return ((second & 0xFU) << 1U) | ((second >> 5U) & 1U); }

uint32_t cortex_float_result(uint16_t first, uint16_t second) {
  if ((first & 0xEF00U) != 0xEE00U) {
    return 0U;
  }
  if ((second & 0x0010U) != 0U) {
    return ((first & 0x0010U) == 0U) ? (left(first, second) + 1U) : 0U;  // VMOV from or to the core
  }
  const bool compares = ((first & 0x00BEU) == 0x00B4U) && ((second & 0x0040U) != 0U);
  return compares ? CORTEX_FLOAT_FLAGS : (target(first, second) + 1U);
}

bool cortex_uses_float(uint16_t first, uint16_t second, uint32_t result) {
  if ((result == 0U) || !is_float(first)) {
    return false;
  }
  const bool flags = (first == 0xEEF1U) && ((second & 0x0FFFU) == 0x0A10U);  // VMRS
  const bool single =
      ((second & 0x0F00U) == 0x0A00U) && (((first & 0xEF00U) == 0xEE00U) || ((first & 0x0120U) == 0x0100U));
  const bool same =
      (result == target(first, second) + 1U) || (result == left(first, second) + 1U) || (result == right(second) + 1U);
  return flags ? (result == CORTEX_FLOAT_FLAGS) : (!single || same);
}

bool cortex_may_branch(uint16_t first, uint16_t second) {
  const bool narrow_branch = ((first & 0xF000U) == 0xD000U) || ((first & 0xF500U) == 0xB100U);
  const bool wide_branch =
      ((first & 0xF800U) == 0xF000U) && ((second & 0xD000U) == 0x8000U) && ((first & 0x0380U) != 0x0380U);
  return narrow_branch || wide_branch;
}
