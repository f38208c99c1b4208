// What went wrong on a limb's bus, counted.
#pragma once

#include <cstdint>

namespace crux {

/// Counts of received frames that were not simply good.
struct LimbStatistics {
  std::uint64_t crc_errors = 0;
  std::uint64_t repeated = 0;    ///< the same E2E counter again: dropped
  std::uint64_t lost = 0;        ///< gaps in an E2E counter; the frame after the gap is used
  std::uint64_t late = 0;        ///< statuses that echo another cycle than the awaited one
  std::uint64_t wrong_size = 0;  ///< payload length or frame type other than the CAN database says
  std::uint64_t unknown = 0;     ///< identifiers outside the CAN database
  std::uint64_t distrusted = 0;  ///< frames of a node that is not what it should be
  std::uint64_t rivals = 0;      ///< frames that show a second sender under a node's identifier
  std::uint64_t foreign = 0;     ///< frames that only a runtime sends, and that this one did not send
  std::uint64_t heartbeats = 0;
  std::uint64_t identities = 0;
  std::uint64_t emergencies = 0;

  LimbStatistics& operator+=(const LimbStatistics& other) noexcept {
    crc_errors += other.crc_errors;
    repeated += other.repeated;
    lost += other.lost;
    late += other.late;
    wrong_size += other.wrong_size;
    unknown += other.unknown;
    distrusted += other.distrusted;
    rivals += other.rivals;
    foreign += other.foreign;
    heartbeats += other.heartbeats;
    identities += other.identities;
    emergencies += other.emergencies;
    return *this;
  }
};

}  // namespace crux
