#include "as5047p.h"

#define ERROR_FLAG 0x4000U
#define VALUE 0x3FFFU

bool crux_as5047p_valid(uint16_t answer) {
  uint32_t folded = answer;
  folded ^= folded >> 8;
  folded ^= folded >> 4;
  folded ^= folded >> 2;
  folded ^= folded >> 1;
  return ((folded & 1U) == 0U) && ((answer & ERROR_FLAG) == 0U);
}

bool crux_as5047p_flagged(uint16_t answer) { return (answer & ERROR_FLAG) != 0U; }

uint32_t crux_as5047p_angle(uint16_t answer) { return answer & VALUE; }
