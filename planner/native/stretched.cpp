#include "stretched.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

void crux_stretched(const crux_stretched_limb* limbs, double least_m, double most_m, std::int64_t pairs,
                    const std::int64_t* node, const std::int64_t* cell, const std::int64_t* options, double* low,
                    double* high) {
  for (std::int64_t p = 0; p < pairs; ++p, low += 3, high += 3) {
    for (int limb = 0; limb < CRUX_STRETCHED_LIMBS; ++limb) {
      const crux_stretched_limb& own = limbs[limb];
      const std::int64_t option = options[CRUX_STRETCHED_LIMBS * node[p] + limb];
      if (option == own.options) {  // in the air
        continue;
      }
      const double* shoulder = own.shoulder + 2 * cell[p];
      const double first[] = {own.least[2 * option] - shoulder[0], own.least[2 * option + 1] - shoulder[1]};
      const double last[] = {own.most[2 * option] - shoulder[0], own.most[2 * option + 1] - shoulder[1]};
      for (int axis = 0; axis < 2; ++axis) {
        const int other = 1 - axis;
        const double beside = std::max(low[other] - most_m - last[other], first[other] - high[other] - most_m);
        const double left = own.squared_m[cell[p]] - std::pow(std::max(beside, 0.0), 2);
        const double ahead = left < 0.0 ? -std::numeric_limits<double>::infinity() : std::sqrt(left);
        low[axis] = std::max(low[axis], first[axis] - ahead + least_m);
        high[axis] = std::min(high[axis], last[axis] + ahead - least_m);
      }
    }
  }
}
