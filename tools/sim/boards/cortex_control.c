/// System control space: NVIC, SysTick, reset request. What has no effect here is kept and read back.
#include "cortex_internal.h"

// Offsets in the system control space.
#define SYST_CVR 0x018U
#define NVIC_ISER 0x100U
#define NVIC_ICER 0x180U
#define NVIC_ISPR 0x200U
#define NVIC_ICPR 0x280U
#define NVIC_IPR 0x400U
#define SCB_AIRCR 0xD0CU
#define SCB_SHPR 0xD18U
#define AIRCR_KEY 0x05FAU
#define AIRCR_SYSRESETREQ (1U << 2U)

uint64_t cortex_read_control(uc_engine *engine, uint64_t offset, unsigned size, void *context) {
  const cortex_m4 *core = context;
  (void)engine;
  (void)size;
  if (offset == SYST_CVR) {
    return (core->systick_at > core->now) && (core->systick_at != CORTEX_NEVER) ? core->systick_at - core->now : 0U;
  }
  if ((offset >= NVIC_ISER) && (offset < NVIC_ICER + 0x80U)) {
    return core->enabled[(offset / 4U) % 4U];
  }
  return core->control_space[(offset / 4U) % 1024U];
}

void cortex_write_control(uc_engine *engine, uint64_t offset, unsigned size, uint64_t value, void *context) {
  cortex_m4 *core = context;
  const unsigned word = (unsigned)((offset / 4U) % 4U);
  const uint32_t bits = (uint32_t)value;
  (void)engine;
  core->stop_at = 0U;  // whatever it is, look at the requests anew
  if ((offset >= NVIC_ISER) && (offset < NVIC_ISER + 16U)) {
    core->enabled[word] |= bits;
  } else if ((offset >= NVIC_ICER) && (offset < NVIC_ICER + 16U)) {
    core->enabled[word] &= ~bits;
  } else if ((offset >= NVIC_ISPR) && (offset < NVIC_ISPR + 16U)) {
    core->pended[word] |= bits;
  } else if ((offset >= NVIC_ICPR) && (offset < NVIC_ICPR + 16U)) {
    core->pended[word] &= ~bits;
  } else {
    for (unsigned i = 0U; i < size; i++) {  // the chip implements four bits of priority
      const uint8_t priority = (uint8_t)((bits >> (8U * i)) & 0xF0U);
      const uint64_t at = offset + i;
      if ((at >= NVIC_IPR) && (at < NVIC_IPR + CORTEX_INTERRUPTS)) {
        core->priority[16U + at - NVIC_IPR] = priority;
      } else if ((at >= SCB_SHPR) && (at < SCB_SHPR + 12U)) {
        core->priority[4U + at - SCB_SHPR] = priority;
      } else {
        // no priority
      }
    }
    core->control_space[(offset / 4U) % 1024U] = bits;
    if ((offset == SYST_CSR) || (offset == SYST_CVR)) {
      const bool on = (core->control_space[SYST_CSR / 4U] & 1U) != 0U;
      core->systick_at = on ? core->now + core->control_space[SYST_RVR / 4U] + 1U : CORTEX_NEVER;
    } else if ((offset == SCB_AIRCR) && ((bits >> 16U) == AIRCR_KEY) && ((bits & AIRCR_SYSRESETREQ) != 0U)) {
      core->wants_reset = true;
    } else {
      // kept, and read back
    }
  }
}
