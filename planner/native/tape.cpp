#include "tape.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define CRUX_WIDE __attribute__((target_clones("avx2", "default")))  // the same numbers, in fewer instructions
#else
#define CRUX_WIDE
#endif

namespace {

constexpr std::size_t kBlock = 8;  // places, so that one instruction is a few of the processor's
using Row = std::array<double, kBlock>;

template <typename Operation>
inline __attribute__((always_inline)) void set(Row& to, const Row& one, const Row& other, Operation operation) {
  Row found;  // `to` may be one of the others
  for (std::size_t i = 0; i < kBlock; ++i) {
    found[i] = operation(one[i], other[i]);
  }
  to = found;
}

double sign(double value) { return value < 0 ? -1.0 : value > 0 ? 1.0 : value; }

/// Some places, from the first on; those beyond the last have its arguments.
struct Block {
  std::int64_t first, places;
  const double* const* arguments;
  const std::int64_t* sizes;
  double* const* results;
  const std::int64_t* result_sizes;

  void read(Row& row, std::int64_t argument, std::int64_t element) const {
    for (std::size_t i = 0; i < kBlock; ++i) {
      const std::int64_t place = std::min(first + static_cast<std::int64_t>(i), places - 1);
      row[i] = arguments[argument][place * sizes[argument] + element];
    }
  }

  void write(const Row& row, std::int64_t result, std::int64_t element) const {
    for (std::int64_t place = first; place < std::min<std::int64_t>(first + kBlock, places); ++place) {
      results[result][place * result_sizes[result] + element] = row[place - first];
    }
  }
};

CRUX_WIDE bool run(const crux_tape& tape, Row* work, const Block& block) {
  for (std::int64_t k = 0; k < tape.instructions; ++k) {
    const std::int32_t operation = tape.operation[k];
    if (operation == CRUX_TAPE_INPUT) {
      block.read(work[tape.to[k]], tape.first[k], tape.second[k]);
      continue;
    }
    const Row& a = work[tape.first[k]];
    if (operation == CRUX_TAPE_OUTPUT) {
      block.write(a, tape.second[k], tape.to[k]);
      continue;
    }
    const Row& b = work[tape.second[k]];
    Row& to = work[tape.to[k]];
    switch (operation) {
      case CRUX_TAPE_CONSTANT:
        to.fill(tape.constant[k]);
        break;
      case CRUX_TAPE_COPY:
        to = a;
        break;
      case CRUX_TAPE_ADD:
        set(to, a, b, [](double x, double y) { return x + y; });
        break;
      case CRUX_TAPE_SUBTRACT:
        set(to, a, b, [](double x, double y) { return x - y; });
        break;
      case CRUX_TAPE_MULTIPLY:
        set(to, a, b, [](double x, double y) { return x * y; });
        break;
      case CRUX_TAPE_DIVIDE:
        set(to, a, b, [](double x, double y) { return x / y; });
        break;
      case CRUX_TAPE_NEGATE:
        set(to, a, b, [](double x, double) { return -x; });
        break;
      case CRUX_TAPE_SQUARE:
        set(to, a, b, [](double x, double) { return x * x; });
        break;
      case CRUX_TAPE_TWICE:
        set(to, a, b, [](double x, double) { return 2.0 * x; });
        break;
      case CRUX_TAPE_INVERT:
        set(to, a, b, [](double x, double) { return 1.0 / x; });
        break;
      case CRUX_TAPE_SQRT:
        set(to, a, b, [](double x, double) { return std::sqrt(x); });
        break;
      case CRUX_TAPE_SIN:
        set(to, a, b, [](double x, double) { return std::sin(x); });
        break;
      case CRUX_TAPE_COS:
        set(to, a, b, [](double x, double) { return std::cos(x); });
        break;
      case CRUX_TAPE_ATAN2:
        set(to, a, b, [](double x, double y) { return std::atan2(x, y); });
        break;
      case CRUX_TAPE_ABS:
        set(to, a, b, [](double x, double) { return std::abs(x); });
        break;
      case CRUX_TAPE_SIGN:
        set(to, a, b, [](double x, double) { return sign(x); });
        break;
      default:
        return false;
    }
  }
  return true;
}

}  // namespace

int crux_tape_run(const crux_tape* tape, std::int64_t places, const double* const* arguments, const std::int64_t* sizes,
                  double* const* results, const std::int64_t* result_sizes) {
  std::vector<Row> work(static_cast<std::size_t>(tape->work));
  for (std::int64_t first = 0; first < places; first += kBlock) {
    if (!run(*tape, work.data(), {first, places, arguments, sizes, results, result_sizes})) {
      return 0;
    }
  }
  return 1;
}
