#include "timeline.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <vector>

namespace {

constexpr int kLimbs = CRUX_TIMELINE_LIMBS;
using Each = std::array<std::int64_t, kLimbs>;

void lower(double& value, double to) { value = std::min(value, to); }

/// Nodes in ascending order, and where the ages of their limbs in the air are among their states.
class Nodes {
 public:
  Nodes(const crux_timeline_options* options, const std::int64_t* nodes, crux_timeline& timeline)
      : options_(options), strides_(static_cast<std::size_t>(timeline.nodes)) {
    std::int64_t first = 0;
    for (std::size_t n = 0; n < strides_.size(); ++n) {
      std::copy_n(nodes + kLimbs * n, kLimbs, nodes_.emplace_back().begin());
      std::int64_t size = 1;
      for (int limb = kLimbs - 1; limb >= 0; --limb) {
        strides_[n][limb] = aloft(n, limb) ? size : 0;
        size *= aloft(n, limb) ? options[limb].ages : 1;
      }
      timeline.first[n] = static_cast<std::int32_t>(first);
      first += size;
    }
    timeline.first[strides_.size()] = static_cast<std::int32_t>(first);
  }

  std::size_t count() const { return nodes_.size(); }
  std::int64_t option(std::size_t node, int limb) const { return nodes_[node][limb]; }
  bool aloft(std::size_t node, int limb) const { return nodes_[node][limb] == options_[limb].many; }
  const Each& strides(std::size_t node) const { return strides_[node]; }

  std::size_t without(std::size_t node, int limb) const {
    Each other = nodes_[node];
    other[limb] = options_[limb].many;
    return static_cast<std::size_t>(std::lower_bound(nodes_.begin(), nodes_.end(), other) - nodes_.begin());
  }

  /// How many knots the limbs have been in the air (0 is the first) in a node's state.
  Each ages(std::size_t node, std::int64_t state) const {
    Each found{};
    for (int limb = 0; limb < kLimbs; ++limb) {
      const std::int64_t stride = strides_[node][limb];
      found[limb] = stride == 0 ? 0 : state / stride % options_[limb].ages;
    }
    return found;
  }

 private:
  const crux_timeline_options* options_;
  std::vector<Each> nodes_, strides_;
};

/// One limb's release from a contact in all states of a node, and its landing there.
void add_changes(const Nodes& nodes, const crux_timeline_options& own, std::size_t node, int limb,
                 crux_timeline& timeline) {
  const std::size_t without = nodes.without(node, limb);
  const Each& strides = nodes.strides(without);
  const std::int64_t air = own.least_air[nodes.option(node, limb)];
  crux_timeline_limb& lists = timeline.limbs[limb];
  for (std::int32_t s = timeline.first[node]; s < timeline.first[node + 1]; ++s) {
    const Each ages = nodes.ages(node, s - timeline.first[node]);
    std::int64_t lifted = timeline.first[without];
    for (int other = 0; other < kLimbs; ++other) {
      lifted += ages[other] * strides[other];
    }
    const std::int64_t i = lists.count++;
    lists.standing[i] = s;
    lists.lifted[i] = static_cast<std::int32_t>(lifted);
    lists.lands_from[i] = static_cast<std::int32_t>(lifted + air * strides[limb]);
    lists.step[i] = static_cast<std::int32_t>(strides[limb]);
    lists.landings[i] = static_cast<std::int32_t>(own.ages - air);
  }
}

}  // namespace

void crux_timeline_states(const crux_timeline_options* options, const std::int64_t* nodes, crux_timeline* timeline) {
  const Nodes all(options, nodes, *timeline);
  for (crux_timeline_limb& limb : timeline->limbs) {
    limb.count = 0;
  }
  for (std::size_t node = 0; node < all.count(); ++node) {
    const Each& strides = all.strides(node);
    for (std::int32_t s = timeline->first[node]; s < timeline->first[node + 1]; ++s) {
      const Each ages = all.ages(node, s - timeline->first[node]);
      std::int64_t younger = s;
      std::int64_t older = s;
      for (int limb = 0; limb < kLimbs; ++limb) {
        younger -= ages[limb] > 0 ? strides[limb] : 0;
        older += ages[limb] < options[limb].ages - 1 ? strides[limb] : 0;
      }
      timeline->younger[s] = static_cast<std::int32_t>(younger);
      timeline->older[s] = static_cast<std::int32_t>(older);
    }
    for (int limb = 0; limb < kLimbs; ++limb) {
      if (!all.aloft(node, limb)) {
        add_changes(all, options[limb], node, limb, *timeline);
      }
    }
  }
}

void crux_timeline_forward(const crux_timeline* timeline, const double* value, const double* cost, double* spent,
                           double* next) {
  for (std::int64_t s = 0; s < timeline->states; ++s) {
    spent[s] = value[s] + cost[s];
  }
  for (std::int64_t s = 0; s < timeline->states; ++s) {
    next[s] = spent[timeline->younger[s]];
  }
  for (const crux_timeline_limb& limb : timeline->limbs) {
    for (std::int64_t i = 0; i < limb.count; ++i) {
      lower(next[limb.lifted[i]], next[limb.standing[i]] + timeline->change);
    }
  }
  for (const crux_timeline_limb& limb : timeline->limbs) {
    for (std::int64_t i = 0; i < limb.count; ++i) {
      lower(next[limb.standing[i]], next[limb.lands_from[i]] + timeline->change);
    }
  }
}

void crux_timeline_backward(const crux_timeline* timeline, double* value, const double* cost, const double* spent,
                            double* before, double* least) {
  for (const crux_timeline_limb& limb : timeline->limbs) {
    for (std::int64_t i = 0; i < limb.count; ++i) {
      const double landed = value[limb.standing[i]] + timeline->change;
      double* in_air = value + limb.lands_from[i];
      for (std::int32_t more = 0; more < limb.landings[i]; ++more, in_air += limb.step[i]) {
        lower(*in_air, landed);
      }
    }
  }
  for (const crux_timeline_limb& limb : timeline->limbs) {
    for (std::int64_t i = 0; i < limb.count; ++i) {
      lower(value[limb.standing[i]], value[limb.lifted[i]] + timeline->change);
    }
  }
  for (std::int64_t node = 0; node < timeline->nodes; ++node) {
    double through = std::numeric_limits<double>::infinity();
    for (std::int32_t s = timeline->first[node]; s < timeline->first[node + 1]; ++s) {
      const double onwards = value[timeline->older[s]];
      lower(through, spent[s] + onwards);
      before[s] = onwards + cost[s];
    }
    least[node] = through;
  }
}
