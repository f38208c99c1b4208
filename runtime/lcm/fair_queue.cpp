#include "lcm/fair_queue.hpp"

#include <utility>

namespace crux {

void FairQueue::put(std::uint64_t sender, crux_msgs::Channel channel, std::span<const std::uint8_t> bytes) {
  const auto found = waiting_.find(sender);
  const bool first = found == waiting_.end();
  const bool full = first ? waiting_.size() == kSenders : found->second.size() == kEach;
  if (full || (bytes_ + bytes.size() > kBytes && (!first || bytes.size() > kSmall))) {
    ++dropped_;
    return;
  }
  (first ? waiting_[sender] : found->second).push_back({sender, channel, {bytes.begin(), bytes.end()}});
  if (first) turns_.push_back(sender);
  bytes_ += bytes.size();
}

std::optional<FairQueue::Message> FairQueue::take() {
  if (turns_.empty()) return std::nullopt;
  const std::uint64_t sender = turns_.front();
  turns_.pop_front();
  const auto found = waiting_.find(sender);
  Message message = std::move(found->second.front());
  found->second.pop_front();
  bytes_ -= message.bytes.size();
  if (found->second.empty())
    waiting_.erase(found);
  else
    turns_.push_back(sender);
  return message;
}

}  // namespace crux
