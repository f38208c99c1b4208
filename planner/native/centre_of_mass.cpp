#include "centre_of_mass.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace {

struct Range {
  double low, high;
};

/// Of |a| for a in a range.
Range sizes(const Range& a) {
  return {std::max(std::max(a.low, -a.high), 0.0), std::max(std::abs(a.low), std::abs(a.high))};
}

/// Of a / |(a, b)| for a in `along` and |b| in `across`.
Range outwards(const Range& along, const Range& across) {
  constexpr double kTiny = 1e-30;
  const double b0 = along.low > 0.0 ? across.high : across.low;
  const double b1 = along.high < 0.0 ? across.high : across.low;
  return {along.low / std::sqrt(along.low * along.low + b0 * b0 + kTiny),
          along.high / std::sqrt(along.high * along.high + b1 * b1 + kTiny)};
}

Range product(const Range& a, const Range& b) {
  const double every[] = {a.low * b.low, a.low * b.high, a.high * b.low, a.high * b.high};
  return {*std::min_element(every, every + 4), *std::max_element(every, every + 4)};
}

/// To bounds (tilts, 2, 3) what a limb adds, its wrist x and y off the shoulder.
void add(const crux_masses& masses, const crux_mass_table& table, const Range& x, const Range& y, double* bounds) {
  const Range far_x = sizes(x);
  const Range far_y = sizes(y);
  const double near = std::sqrt(far_x.low * far_x.low + far_y.low * far_y.low);
  const double squared = far_x.high * far_x.high + far_y.high * far_y.high;
  const Range ways[] = {outwards(x, far_y), outwards(y, far_x)};
  for (std::int64_t t = 0; t < masses.tilts; ++t, bounds += 6) {
    const double height = table.height[t];
    const auto cell = [&](double far_m) { return static_cast<std::int64_t>(far_m / masses.cell_m); };
    const std::int64_t last = std::min(cell(std::sqrt(squared + height * height)), table.cells - 1);
    const double inner = near * masses.cosine[t] - height * masses.sine[t];
    const std::int64_t first = std::min(cell(std::max(inner, 0.0)), last);
    const double* ends = table.ends + CRUX_MASS_ENDS * ((t * table.cells + first) * table.cells + last);
    for (int axis = 0; axis < 2; ++axis) {
      const Range way{std::max(ways[axis].low - ends[4], -1.0), std::min(ways[axis].high + ends[4], 1.0)};
      const Range out = product({ends[0], ends[1]}, way);
      bounds[axis] += out.low - masses.aside[t];
      bounds[3 + axis] += out.high + masses.aside[t];
    }
    bounds[2] += ends[2];
    bounds[5] += ends[3];
  }
}

}  // namespace

void crux_mass_bounds(const crux_masses* masses, std::int64_t pairs, const double* low, const double* high,
                      const std::int64_t* node, const std::int64_t* cell, const std::int64_t* options, double* bounds) {
  const std::int64_t size = 6 * masses->tilts;
  for (std::int64_t p = 0; p < pairs; ++p, low += 3, high += 3, bounds += size) {
    std::copy_n(masses->own, size, bounds);
    for (int limb = 0; limb < CRUX_MASS_LIMBS; ++limb) {
      const crux_mass_limb& own = masses->limbs[limb];
      const std::int64_t option = options[CRUX_MASS_LIMBS * node[p] + limb];
      Range off[2];
      for (int i = 0; i < 2; ++i) {
        const double shoulder = own.shoulder[2 * cell[p] + i];
        const double wide = own.wide[cell[p]];
        off[i] = {own.least[3 * option + i] - high[i] - masses->shift_m - shoulder - wide,
                  own.most[3 * option + i] - low[i] + masses->shift_m - shoulder + wide};
      }
      add(*masses, own.tables[option == own.options - 1], off[0], off[1], bounds);
    }
    std::for_each(bounds, bounds + size, [&](double& end) { end /= masses->mass_kg; });
  }
}
