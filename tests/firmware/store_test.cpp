// The store of parameters: whatever operation the power fails in, the snapshot before it or the new one is there.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <vector>

extern "C" {
#include "flash_model.h"
#include "store.h"
}

namespace {

using Entries = std::vector<std::pair<int, std::uint32_t>>;

struct Memory {
  std::array<std::uint8_t, CRUX_STORE_PAGES * CRUX_FLASH_PAGE> bytes{};
  std::array<bool, CRUX_STORE_PAGES * CRUX_FLASH_PAGE / CRUX_FLASH_UNIT> damaged{};
  crux_flash_model model{};
  crux_flash flash{};
  crux_store store{};
  Memory() {
    crux_flash_model_init(&model, bytes.data(), damaged.data(), static_cast<std::uint32_t>(bytes.size()));
    flash = crux_flash_model_interface(&model);
    store = {&flash, 2, {0, CRUX_FLASH_PAGE}};
  }
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;
  [[nodiscard]] Entries load() const {
    std::array<crux_stored, CRUX_STORE_CAPACITY> found{};
    const int count = crux_store_load(&store, found.data());
    Entries result;
    for (int i = 0; i < count; ++i) result.emplace_back(found[i].id, found[i].bits);
    return result;
  }
  [[nodiscard]] bool save(const Entries& entries) const {
    std::vector<crux_stored> raw;
    for (const auto& [id, bits] : entries) raw.push_back({static_cast<std::uint8_t>(id), bits});
    return crux_store_save(&store, raw.data(), static_cast<std::uint8_t>(raw.size()));
  }
};

// Different in number and content from step to step.
Entries snapshot(unsigned step) {
  Entries entries;
  for (unsigned i = 0; i <= step % 7; ++i) entries.emplace_back(i + 1, step * 100 + i);
  return entries;
}

TEST(Store, IsEmptyAtFirstAndThenHoldsTheLastSnapshot) {
  Memory memory;
  EXPECT_TRUE(memory.load().empty());
  for (unsigned step = 1; step < 300; ++step) {
    ASSERT_TRUE(memory.save(snapshot(step)));
    ASSERT_EQ(memory.load(), snapshot(step));
  }
  EXPECT_TRUE(memory.save({}));
  EXPECT_TRUE(memory.load().empty());
}

TEST(Store, PowerLostInAnyOperationLeavesTheOldOrTheNewSnapshot) {
  for (const crux_flash_cut cut : {CRUX_FLASH_CUT_BEFORE, CRUX_FLASH_CUT_WITHIN, CRUX_FLASH_CUT_AFTER}) {
    Memory memory;
    ASSERT_TRUE(memory.save(snapshot(0)));
    Entries before = snapshot(0);
    unsigned kept = 0;
    for (unsigned step = 1; step < 900; ++step) {
      crux_flash_model_power(&memory.model, 1 + step % 10, cut);
      const bool saved = memory.save(snapshot(step));
      crux_flash_model_power(&memory.model, 0, cut);
      const Entries found = memory.load();
      ASSERT_TRUE(found == snapshot(step) || (!saved && found == before)) << step;
      kept += found == before ? 1 : 0;
      before = found;
    }
    EXPECT_GT(kept, 100U);
    ASSERT_TRUE(memory.save(snapshot(5)));
    EXPECT_EQ(memory.load(), snapshot(5));
  }
}

TEST(Store, ProgramsInTwoBanksReadAllPagesAndWriteTheirOwn) {
  Memory memory;
  constexpr std::uint32_t kPage = CRUX_FLASH_PAGE;
  const crux_store programs[] = {{&memory.flash, 4, {0, kPage, 2 * kPage, 3 * kPage}},
                                 {&memory.flash, 4, {2 * kPage, 3 * kPage, 0, kPage}}};
  for (unsigned step = 1; step < 500; ++step) {
    const std::size_t running = (step / 13) % 2;  // an update now and then
    memory.store = programs[running];
    ASSERT_EQ(memory.load(), step > 1 ? snapshot(step - 1) : Entries{});
    const auto before = memory.bytes;
    ASSERT_TRUE(memory.save(snapshot(step)));
    const auto foreign = static_cast<std::ptrdiff_t>(running == 0 ? 2 * kPage : 0);
    ASSERT_TRUE(
        std::equal(before.begin() + foreign, before.begin() + foreign + 2 * kPage, memory.bytes.begin() + foreign));
    ASSERT_EQ(memory.load(), snapshot(step));
  }
}

}  // namespace
