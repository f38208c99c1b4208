// Updates on a flash that loses its power in every single operation: a valid image always starts.
#include <gtest/gtest.h>

#include <array>
#include <memory>

#include "signed_image.hpp"

extern "C" {
#include "crux_services.h"
#include "flash_model.h"
#include "update.h"
#include "update_service.h"
}

namespace {

using namespace crux::firmware::signed_image;

constexpr std::uint32_t kSlot = 4 * CRUX_FLASH_PAGE;
constexpr std::uint32_t kJoint = kJointKind;

// Two slots of four pages.
struct Board {
  std::array<std::uint8_t, 2 * kSlot> bytes{};
  std::array<bool, 2 * kSlot / CRUX_FLASH_UNIT> damaged{};
  crux_flash_model model{};
  crux_flash flash{};
  crux_slots slots{};
  crux_running running{};
  crux_update update{};
  Board() {
    crux_flash_model_init(&model, bytes.data(), damaged.data(), static_cast<std::uint32_t>(bytes.size()));
    flash = crux_flash_model_interface(&model);
    slots = {&flash, {0, kSlot}, kSlot, 0, kJoint, signer().key.data()};
    boot();
  }
  Board(const Board& other) : Board() {
    bytes = other.bytes;
    damaged = other.damaged;
    boot();
  }
  Board& operator=(const Board&) = delete;

  bool boot() {
    const bool found = crux_boot(&slots, &running);
    crux_update_init(&update, &slots, &running);
    return found;
  }
  void power(std::uint32_t cut_at = 0, crux_flash_cut cut = CRUX_FLASH_CUT_AFTER) {
    crux_flash_model_power(&model, cut_at, cut);
  }
  std::uint8_t block(std::uint8_t number, const Bytes& payload, std::size_t from, std::size_t size) {
    return crux_update_block(&update, number, payload.data() + from, static_cast<std::uint32_t>(size));
  }
  // First refusal, NONE when the image is in.
  std::uint8_t load(const Image& image, std::size_t size = 256) {
    std::uint8_t refusal = crux_update_begin(&update, image.header.data());
    std::uint8_t number = 1;
    for (std::size_t from = 0; refusal == CRUX_REFUSAL_NONE && from < image.payload.size(); from += size) {
      refusal = block(number++, image.payload, from, std::min(size, image.payload.size() - from));
    }
    return refusal == CRUX_REFUSAL_NONE ? crux_update_end(&update) : refusal;
  }
  bool confirm() { return crux_boot_confirm(&slots, &update.running); }
  // From the image's load to its confirmation.
  void whole_update(const Image& image) {
    load(image);
    boot();
    confirm();
  }
};

const Board& with_version_one() {
  static const std::unique_ptr<Board> board = [] {
    auto made = std::make_unique<Board>();
    made->whole_update(Image(1));
    return made;
  }();
  return *board;
}

TEST(Update, StartsTheNewestConfirmedImage) {
  Board board;
  EXPECT_FALSE(board.boot());
  EXPECT_EQ(board.running.slot, CRUX_NO_SLOT);
  for (std::uint32_t version = 1; version < 6; ++version) {
    ASSERT_EQ(board.load(Image(version)), CRUX_REFUSAL_NONE);
    ASSERT_TRUE(board.boot());
    EXPECT_EQ(board.running.version, version);
    EXPECT_EQ(board.running.slot, (version + 1) % 2);
    EXPECT_FALSE(board.running.confirmed);
    EXPECT_TRUE(board.confirm());
    board.boot();
    EXPECT_TRUE(board.running.confirmed);
  }
}

TEST(Update, AValidImageStartsWhereverThePowerIsCutAndTheUpdateGoesThroughAfterwards) {
  const Image image(2);
  Board counted(with_version_one());
  counted.whole_update(image);
  const std::uint32_t operations = counted.model.operations;
  ASSERT_GT(operations, 300U);
  std::array<int, 3> started{};
  for (std::uint32_t cut_at = 1; cut_at <= operations; ++cut_at) {
    for (const crux_flash_cut cut : {CRUX_FLASH_CUT_BEFORE, CRUX_FLASH_CUT_WITHIN, CRUX_FLASH_CUT_AFTER}) {
      Board board(with_version_one());
      board.power(cut_at, cut);
      board.whole_update(image);
      board.power();
      ASSERT_TRUE(board.boot()) << cut_at;
      std::uint32_t version = 0;
      ASSERT_TRUE(crux_slot_is_valid(&board.slots, board.running.slot, &version));
      ASSERT_EQ(version, board.running.version);
      ++started.at(version);
      // Once more, and the power fails again.
      board.power(1 + cut_at * 7 % operations, cut);
      version == 1 ? board.whole_update(image) : void(board.confirm());
      board.power();
      ASSERT_TRUE(board.boot()) << cut_at;
      if (board.running.version == 1) {
        ASSERT_EQ(board.load(image), CRUX_REFUSAL_NONE) << cut_at;
        ASSERT_TRUE(board.boot());
      }
      ASSERT_EQ(board.running.version, 2U) << cut_at;
      ASSERT_TRUE(board.confirm());
    }
  }
  EXPECT_EQ(started[0], 0);
  EXPECT_GT(started[1], 300);
  EXPECT_GT(started[2], 0);
}

TEST(Update, AnImageThatNeverConfirmsIsLeftAfterThreeTries) {
  Board board(with_version_one());
  ASSERT_EQ(board.load(Image(2)), CRUX_REFUSAL_NONE);
  for (unsigned i = 0; i < CRUX_BOOT_TRIES; ++i) {
    board.boot();
    EXPECT_EQ(board.running.version, 2U);
  }
  board.boot();
  EXPECT_EQ(board.running.version, 1U);
  EXPECT_TRUE(board.running.confirmed);
  EXPECT_EQ(board.load(Image(2)), CRUX_REFUSAL_NONE);  // a better one may come under the same number
}

TEST(Update, ARejectedImageDoesNotComeBackWhenTheNextUpdateIsCutShort) {
  Board board(with_version_one());
  board.load(Image(9));
  for (unsigned i = 0; i <= CRUX_BOOT_TRIES; ++i) board.boot();
  ASSERT_EQ(board.running.version, 1U);
  for (std::uint32_t cut_at = 1; cut_at < 4; ++cut_at) {
    for (const crux_flash_cut cut : {CRUX_FLASH_CUT_BEFORE, CRUX_FLASH_CUT_WITHIN, CRUX_FLASH_CUT_AFTER}) {
      Board cut_short(board);
      cut_short.power(cut_at, cut);
      cut_short.load(Image(3));
      cut_short.power();
      cut_short.boot();
      EXPECT_EQ(cut_short.running.version, 1U) << cut_at;
    }
  }
}

TEST(Update, TheOnlyValidImageStartsEvenAfterThreeTries) {
  Board board;
  board.load(Image(1));
  for (int i = 0; i < 6; ++i) {
    ASSERT_TRUE(board.boot());
    EXPECT_EQ(board.running.version, 1U);
  }
}

TEST(Update, WhatIsNotForThisNodeIsRefusedBeforeAnythingIsErased) {
  Board board(with_version_one());
  const auto refused = [&board](const Bytes& header, std::uint8_t refusal) {
    EXPECT_EQ(crux_update_begin(&board.update, header.data()), refusal);
    EXPECT_EQ(board.block(1, Bytes(8), 0, 8), CRUX_REFUSAL_SEQUENCE);
  };
  const std::uint32_t before = board.model.operations;
  const Image good(2);
  for (std::size_t i = 0; i < CRUX_IMAGE_HEADER; ++i) {
    Bytes changed = good.header;
    changed[i] ^= 0x10U;
    refused(changed, CRUX_REFUSAL_SIGNATURE);
  }
  refused(Image(1).header, CRUX_REFUSAL_NOT_ACCEPTED);     // not newer
  refused(Image(2, 2).header, CRUX_REFUSAL_NOT_ACCEPTED);  // a gripper's
  refused(Image(2, kJoint, crux_slot_capacity(&board.slots) + 1).header, CRUX_REFUSAL_NOT_ACCEPTED);
  refused(Image(2, kJoint, 0).header, CRUX_REFUSAL_NOT_ACCEPTED);
  board.update.running.confirmed = false;
  refused(good.header, CRUX_REFUSAL_NOT_ACCEPTED);
  board.update.running.confirmed = true;
  board.slots.key = nullptr;
  refused(good.header, CRUX_REFUSAL_SIGNATURE);
  EXPECT_EQ(board.model.operations, before);
}

TEST(Update, BlocksComeInTurnAndADamagedPayloadIsNoImage) {
  Board board(with_version_one());
  const Image image(2);
  ASSERT_EQ(crux_update_begin(&board.update, image.header.data()), CRUX_REFUSAL_NONE);
  EXPECT_EQ(board.block(2, image.payload, 0, 256), CRUX_REFUSAL_BLOCK_NUMBER);
  EXPECT_EQ(board.block(1, image.payload, 0, 0), CRUX_REFUSAL_LENGTH);
  EXPECT_EQ(board.block(1, image.payload, 0, 255), CRUX_REFUSAL_LENGTH);
  EXPECT_EQ(board.block(1, image.payload, 0, 256), CRUX_REFUSAL_NONE);
  EXPECT_EQ(board.block(1, image.payload, 0, 256), CRUX_REFUSAL_NONE);  // the answer was lost
  EXPECT_EQ(board.block(2, image.payload, 256, 1024), CRUX_REFUSAL_NONE);
  EXPECT_EQ(board.block(3, Bytes(4096), 0, 4096), CRUX_REFUSAL_LENGTH);
  EXPECT_EQ(crux_update_end(&board.update), CRUX_REFUSAL_SEQUENCE);
  EXPECT_EQ(board.block(3, image.payload, 1280, 1221), CRUX_REFUSAL_SEQUENCE);  // it was given up

  Image damaged(2);
  damaged.payload[1000] ^= 1U;
  EXPECT_EQ(board.load(damaged), CRUX_REFUSAL_SIGNATURE);
  board.boot();
  EXPECT_EQ(board.running.version, 1U);
  EXPECT_EQ(board.load(image, 1016), CRUX_REFUSAL_NONE);
  board.boot();
  EXPECT_EQ(board.running.version, 2U);
}

TEST(Update, AConfirmedImageIsKnownByItsCrcAndAChangedOneIsNotStarted) {
  Board board(with_version_one());
  board.whole_update(Image(2));
  Board stranger(board);
  const auto no_key = std::array<std::uint8_t, 32>{};
  stranger.slots.key = no_key.data();  // no signature holds any more
  ASSERT_TRUE(stranger.boot());
  EXPECT_EQ(stranger.running.version, 2U);
  EXPECT_TRUE(stranger.running.confirmed);
  for (const std::uint32_t at : {12U, 100U, 191U, 512U, 2000U, 512U + 2500U}) {
    Board changed(board);
    changed.bytes.at(kSlot + at) ^= 0x20U;
    ASSERT_TRUE(changed.boot()) << at;
    EXPECT_EQ(changed.running.version, 1U) << at;
  }
}

TEST(Update, TellingOfTheSlotsReadsNoFlash) {
  Board board(with_version_one());
  const std::array<std::uint8_t, 10> before{0, 1, 1, 0, 0, 0, 0, 0, 0, 0};  // slot 0, confirmed, version 1; no other
  const auto told = [&board] {
    const auto read = board.flash.read;
    board.flash.read = nullptr;  // a signature takes too long while a node tracks
    crux_reply reply{};
    crux_update_tell(&board.update, &reply);
    board.flash.read = read;
    return Bytes(reply.bytes, reply.bytes + 10);
  };
  EXPECT_EQ(told(), Bytes(before.begin(), before.end()));
  ASSERT_EQ(board.load(Image(2)), CRUX_REFUSAL_NONE);
  EXPECT_EQ(told()[6], 2);
  board.boot();
  EXPECT_EQ(told()[6], 1);
  board.confirm();
  ASSERT_EQ(crux_update_begin(&board.update, Image(3).header.data()), CRUX_REFUSAL_NONE);
  EXPECT_EQ(told()[6], 0);
}

TEST(Update, AnImageMayFillTheSlot) {
  Board board;
  const Image image(1, kJoint, crux_slot_capacity(&board.slots));
  ASSERT_EQ(board.load(image, 1024), CRUX_REFUSAL_NONE);
  EXPECT_TRUE(board.boot());
}

TEST(Update, ASlotClaimsNoImageLongerThanItself) {
  Board board;
  const std::uint32_t most = crux_slot_capacity(&board.slots);
  for (const std::uint32_t length : {most, most + 1}) {
    const Image image(1, kJoint, length);
    std::copy(image.header.begin(), image.header.end(), board.bytes.begin());
    crux_image found{};
    EXPECT_EQ(crux_slot_claims(&board.slots, 0, &found), length == most);
  }
}

}  // namespace
