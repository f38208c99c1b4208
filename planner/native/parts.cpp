#include <cstddef>
#include <cstdint>
#include <vector>

#include "reach.h"

namespace {

/// The first cell of the part that a cell is known to be in, with the way there shortened.
std::int64_t first_of(std::int64_t* leads_to, std::int64_t cell) {
  while (leads_to[cell] != cell) {
    cell = leads_to[cell] = leads_to[leads_to[cell]];
  }
  return cell;
}

}  // namespace

std::int64_t crux_reach_parts(std::int64_t axes, const std::int64_t* shape, const std::uint8_t* inside,
                              std::int64_t* numbers) {
  std::int64_t cells = 1;
  std::vector<std::int64_t> strides(static_cast<std::size_t>(axes));
  for (std::int64_t axis = axes; axis-- > 0;) {
    strides[axis] = cells;
    cells *= shape[axis];
  }
  for (std::int64_t cell = 0; cell < cells; ++cell) {  // at first: a cell of the same part, no later one
    numbers[cell] = cell;
    for (std::int64_t axis = 0; inside[cell] != 0 && axis < axes; ++axis) {
      const std::int64_t before = cell - strides[axis];
      if (cell / strides[axis] % shape[axis] == 0 || inside[before] == 0) {
        continue;
      }
      const std::int64_t one = first_of(numbers, cell);
      const std::int64_t other = first_of(numbers, before);
      numbers[one < other ? other : one] = one < other ? one : other;
    }
  }
  std::int64_t count = 0;
  for (std::int64_t cell = 0; cell < cells; ++cell) {  // what a cell leads to has its number already, below 0
    const std::int64_t first = numbers[cell];
    numbers[cell] = inside[cell] == 0 ? 0 : first == cell ? -++count : numbers[first];
  }
  for (std::int64_t cell = 0; cell < cells; ++cell) {
    numbers[cell] = -numbers[cell];
  }
  return count;
}
