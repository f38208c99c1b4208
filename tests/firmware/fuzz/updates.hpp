// A node's services with a flash behind them: parameters and two slots, the first with an image that has confirmed
// itself. And what a fuzzed host does about its firmware.
#pragma once

#include <array>
#include <memory>
#include <vector>

#include "judge.hpp"
#include "signed_image.hpp"

extern "C" {
#include "flash_model.h"
#include "service.h"
#include "update_service.h"
}

namespace crux::firmware {

using signed_image::Image;

struct UpdatesTally {
  unsigned long long taken = 0;
  unsigned long long started = 0;
};
inline UpdatesTally updates_tally;

inline bool is_at_rest(std::uint8_t state) {
  return state == CRUX_STATE_BOOT || state == CRUX_STATE_HOLD || state == CRUX_STATE_FAULT;
}

struct Services {
  static constexpr std::uint32_t kSlot = 4 * CRUX_FLASH_PAGE;
  static constexpr std::uint32_t kBytes = 2 * CRUX_FLASH_PAGE + 2 * kSlot;
  std::vector<Image> images;  // version 1, 2, …
  std::array<std::uint8_t, kBytes> bytes{};
  std::array<std::uint8_t, kBytes> factory{};
  std::array<bool, kBytes / CRUX_FLASH_UNIT> damaged{};
  crux_flash_model model{};
  crux_flash flash{};
  crux_store store{};
  crux_slots slots{};
  crux_running running{};
  crux_update update{};
  crux_service service{};
  unsigned long long operations_before = 0;

  explicit Services(std::uint32_t kind) {
    for (std::uint32_t version = 1; version <= 5; ++version)
      images.emplace_back(version, kind, 300 * version + version);
    crux_flash_model_init(&model, bytes.data(), damaged.data(), kBytes);
    flash = crux_flash_model_interface(&model);
    store = {&flash, 2, {0, CRUX_FLASH_PAGE}};
    slots = {
        &flash, {2 * CRUX_FLASH_PAGE, 2 * CRUX_FLASH_PAGE + kSlot}, kSlot, 0, kind, signed_image::signer().key.data()};
    running.slot = CRUX_NO_SLOT;
    running.confirmed = true;
    crux_update_init(&update, &slots, &running);
    const Image& first = images.front();
    crux_update_begin(&update, first.header.data());
    crux_update_block(&update, 1, first.payload.data(), static_cast<std::uint32_t>(first.payload.size()));
    require(crux_update_end(&update) == CRUX_REFUSAL_NONE, "the first image is not taken");
    boot();
    crux_boot_confirm(&slots, &running);
    factory = bytes;
  }
  Services(const Services&) = delete;
  Services& operator=(const Services&) = delete;

  void renew() {
    bytes = factory;
    damaged = {};
    running = {};
  }
  void power(std::uint32_t cut_at = 0, crux_flash_cut cut = CRUX_FLASH_CUT_AFTER) {
    operations_before += model.operations;
    crux_flash_model_power(&model, cut_at, cut);
  }
  [[nodiscard]] unsigned long long operations() const { return operations_before + model.operations; }

  // The power is back, or the node restarts.
  void boot() {
    const std::uint32_t before = running.version;
    power();
    require(crux_boot(&slots, &running), "no image starts");
    require(running_is_whole(), "an image starts that is not whole");
    updates_tally.started += (running.version > before && before != 0) ? 1 : 0;
    crux_update_init(&update, &slots, &running);
  }
  [[nodiscard]] bool running_is_whole() const {
    if (running.version == 0 || running.version > images.size()) return false;
    const Image& image = images[running.version - 1];
    const std::uint8_t* slot = bytes.data() + slots.address[running.slot];
    return std::equal(image.header.begin(), image.header.end(), slot) &&
           std::equal(image.payload.begin(), image.payload.end(), slot + CRUX_SLOT_PAYLOAD);
  }
  bool restarts() { return model.off || crux_service_restarts(&service); }

  void hear(const crux_frame& frame, std::uint8_t state) { crux_service_on_frame(&service, &frame, state); }
  // One request; whether it was accepted. Whatever was going on, this one is heard.
  bool request(std::uint8_t node, std::uint8_t state, const std::vector<std::uint8_t>& message) {
    crux_frame frame{};
    crux_frame answer{};
    frame.id = static_cast<std::uint16_t>(CRUX_CAN_ID_JOINT_REQUEST(node));
    crux_isotp_init(&service.isotp, frame.id, static_cast<std::uint16_t>(CRUX_CAN_ID_JOINT_RESPONSE(node)));
    const auto put = [&frame](std::size_t byte) { frame.data[frame.length++] = static_cast<std::uint8_t>(byte); };
    std::size_t at = 0;
    if (message.size() <= 7) {
      put(message.size());
    } else {
      put(0x10 | (message.size() >> 8));
      put(message.size());
    }
    for (std::size_t number = 1; frame.length != 0; ++number) {
      while (frame.length < 64 && at < message.size()) put(message[at++]);
      while (message.size() > 7 && frame.length < 64) put(0xCC);
      hear(frame, state);
      if (number == 1 && message.size() > 7) crux_service_take_frame(&service, &answer);  // go on
      frame.length = 0;
      if (at < message.size()) put(0x20 | (number % 16));
    }
    return crux_service_take_frame(&service, &answer) && answer.data[1] != CRUX_SERVICE_REFUSED;
  }
};

// Whose update it is: a tool's, in turn and of a newer image, or with a step out of turn, a byte changed, or no power.
enum class Host { kTool, kFickle };

// The next step of an update.
inline void update(Bytes& bytes, Services& services, std::uint8_t node, std::uint8_t state, Host host) {
  constexpr std::uint8_t kNoWhim = 15;
  crux_update& update = services.update;
  const std::uint32_t length = update.active ? crux_word_at(&update.header[16]) : 0;
  const bool is_tool = host == Host::kTool;
  const std::uint8_t whim = is_tool ? kNoWhim : bytes.take<std::uint8_t>() % 16U;
  std::vector<std::uint8_t> message;
  const auto acknowledge = [&] {
    const std::uint32_t word = (whim == 1) ? bytes.take<std::uint32_t>() : CRUX_ACKNOWLEDGEMENT_OFF_THE_WALL;
    for (int i = 0; i < 4; ++i) message.push_back(static_cast<std::uint8_t>(word >> (8 * i)));
  };
  const bool loaded = update.target_version > update.running.version && !update.active;
  if (whim == 2 || (loaded && (is_tool || whim < 12))) {
    message = {CRUX_SERVICE_RESET, 1};
    acknowledge();
  } else if (!update.active || whim == 3) {
    const std::size_t newer = std::min<std::size_t>(update.running.version, services.images.size() - 1);
    const Image& image = services.images[is_tool ? newer : bytes.take<std::uint8_t>() % services.images.size()];
    message = {CRUX_SERVICE_DOWNLOAD};
    acknowledge();
    message.insert(message.end(), image.header.begin(), image.header.end());
  } else if (update.received < length || whim == 4) {
    const Image& image = services.images[crux_word_at(&update.header[12]) - 1];
    const std::size_t from = std::min<std::size_t>(update.received, image.payload.size());
    const std::size_t wanted = 8U * (1U + bytes.take<std::uint8_t>() % 127U);
    const std::size_t taken = std::min(wanted, image.payload.size() - from);
    message = {CRUX_SERVICE_TRANSFER, static_cast<std::uint8_t>(update.block + ((whim == 5) ? 0 : 1))};
    const auto start = image.payload.begin() + static_cast<std::ptrdiff_t>(from);
    message.insert(message.end(), start, start + static_cast<std::ptrdiff_t>(taken));
  } else {
    message = {CRUX_SERVICE_TRANSFER_EXIT};
  }
  if (whim == 6) {
    const auto at = bytes.take<std::uint16_t>() % message.size();
    message[at] = static_cast<std::uint8_t>(message[at] ^ (1U << (bytes.take<std::uint8_t>() % 8U)));
  }
  if (whim == 7 || whim == 8) {
    services.power(1 + bytes.take<std::uint8_t>() % 64U, static_cast<crux_flash_cut>(bytes.take<std::uint8_t>() % 3U));
  }
  const bool accepted = services.request(node, state, message);
  require(!accepted || is_at_rest(state), "a moving node obeys a request about its firmware");
  const bool begins = message[0] == CRUX_SERVICE_RESET || message[0] == CRUX_SERVICE_DOWNLOAD;
  require(!accepted || !begins || !services.service.commanded, "a commanded node restarts or takes an image");
  updates_tally.taken += (accepted && message[0] == CRUX_SERVICE_TRANSFER_EXIT) ? 1 : 0;
}

}  // namespace crux::firmware
