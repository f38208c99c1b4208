/// Branch and prune over boxes of body poses.
///
/// In a box, each limb has options: a grip, and where on it the gripper may be. The
/// conditions of an option, and of two limbs' options together, cut the box and the option, or show that there is none
/// in it. A box in which some limb has no option left, or two have none together, is done; what is left of others is
/// halved.
#include "refute.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <optional>
#include <utility>
#include <vector>

#include "held_limb.hpp"
#include "pose_box.hpp"
#include "range.hpp"

namespace crux {
namespace {

constexpr int kCuts = 2;         ///< of a box before it is halved
constexpr double kShrunk = 0.6;  ///< of its width along some axis, for it to be cut again
constexpr double kTiny = 1e-6;   ///< [m] a box that is left and no wider counts as a pose
/// How far [m] a unit moves a gripper in the body frame.
constexpr std::array<double, kBody> kSizes{1.0, 1.0, 1.0, 0.25, 0.25, 0.25};

class Search {
 public:
  Search(const crux_refute_goal& goal, const crux_refute_grip* grips, std::size_t count, const std::uint8_t* together,
         double clear_m, std::int64_t looks, double seconds)
      : goal_(goal),
        grips_(grips),
        count_(count),
        together_(together),
        clear_m_(clear_m),
        looks_(looks),
        until_s_(now_s() + seconds) {}

  /// As `crux_refute`.
  [[nodiscard]] int answer() {
    std::vector<Box> left{whole()};
    while (!left.empty()) {
      Box box = std::move(left.back());
      left.pop_back();
      if (!cut(box)) {
        continue;
      }
      if (tiny(box) || holds(box)) {
        return 0;
      }
      if (looks_ <= 0 || now_s() > until_s_) {
        return -1;
      }
      halve(std::move(box), left);
    }
    return 1;
  }

 private:
  static double now_s() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

  [[nodiscard]] Box whole() const {
    Box box;
    std::copy(std::begin(goal_.low), std::end(goal_.low), box.low.begin());
    std::copy(std::begin(goal_.high), std::end(goal_.high), box.high.begin());
    for (std::size_t g = 0; g < count_; ++g) {
      const crux_refute_grip& grip = grips_[g];
      for (const double ahead : {1.0, -1.0}) {
        box.options[static_cast<std::size_t>(grip.limb)].push_back(
            {g, ahead, {-grip.aside_m, grip.height_m[0]}, {grip.aside_m, grip.height_m[1]}, {}});
      }
    }
    return box;
  }

  /// Cuts a box and its options, again while that takes much of it. False: nothing is left.
  [[nodiscard]] bool cut(Box& box) {
    for (int i = 0; i < kCuts; ++i) {
      const Box before = box;
      if (!cut_once(box)) {
        return false;
      }
      bool shrunk = false;
      for (std::size_t k = 0; k < kBody; ++k) {
        shrunk = shrunk || box.high[k] - box.low[k] < kShrunk * (before.high[k] - before.low[k]);
      }
      if (!shrunk) {
        break;
      }
    }
    return true;
  }

  [[nodiscard]] bool cut_once(Box& box) {
    Body body;
    for (std::size_t i = 0; i < kBody; ++i) {
      body[i] = model(box.low[i], box.high[i], i);
    }
    Range<kVariables> range;
    const std::vector<Form> goal = linear(at_goal(goal_, body));
    if (!range.cut(goal)) {
      return false;
    }
    std::vector<Limb> limbs(box.options.begin(), box.options.end());
    for (Limb& limb : limbs) {
      if (!limb.options.empty() && !cut_by_limb(body, goal, limb, range)) {
        return false;
      }
    }
    for (std::size_t a = 0; a < kLimbs; ++a) {
      for (std::size_t b = a + 1; b < kLimbs; ++b) {
        if (!limbs[a].options.empty() && !limbs[b].options.empty() &&
            !cut_by_two(body, goal, limbs[a], limbs[b], range)) {
          return false;
        }
      }
    }
    for (std::size_t i = 0; i < kBody; ++i) {
      keep(box.low[i], box.high[i], range.low[i], range.high[i]);
    }
    keep_what_bends(limbs, box);
    std::transform(limbs.begin(), limbs.end(), box.options.begin(), left_of);
    return true;
  }

  /// Of links that meet others, or of all that were looked at.
  static void keep_what_bends(std::vector<Limb>& limbs, Box& box) {
    bool met = false;
    for (const Limb& limb : limbs) {
      met = met || std::any_of(limb.looked.begin(), limb.looked.end(), [](const Looked& each) { return each.meets; });
    }
    box.bent.fill(0.0);
    for (Limb& limb : limbs) {
      for (Looked& each : limb.looked) {
        if (met && !each.meets) {
          each.bent.fill(0.0);
        }
        for (std::size_t i = 0; i < kBody; ++i) {
          box.bent[i] = std::max(box.bent[i], each.bent[i]);
        }
      }
    }
  }

  /// The options that a limb has, those looked at first.
  static std::vector<Option> left_of(const Limb& limb) {
    std::vector<Option> left;
    for (const Limb::Has has : {Limb::Has::Some, Limb::Has::Unknown}) {
      for (std::size_t k = 0; k < limb.options.size(); ++k) {
        if (limb.has[k] == has) {
          left.push_back(limb.options[k]);
          left.back().bent = {};
          const Looked& looked = limb.looked[k];
          for (std::size_t i = 0; i < 2 && has == Limb::Has::Some; ++i) {
            keep(left.back().low[i], left.back().high[i], looked.range.low[kBody + i], looked.range.high[kBody + i]);
            left.back().bent[i] = looked.bent[kBody + i];
          }
        }
      }
    }
    return left;
  }

  /// Whether a limb has an option in the range, which is then looked at.
  bool has(const Body& body, const std::vector<Form>& goal, Limb& limb, std::size_t k, const Range<kVariables>& range) {
    if (limb.has[k] == Limb::Has::Unknown) {
      --looks_;
      const Option& option = limb.options[k];
      const crux_refute_grip& grip = grips_[option.grip];
      const Model aside = model(option.low[0], option.high[0], kBody);
      const Model height = model(option.low[1], option.high[1], kBody + 1);
      Looked& looked = limb.looked[k];
      const HeldLimb<Model> held =
          held_limb<Model>(grip, option.ahead, {body[3], body[4], body[5]}, wrist_on(grip, body, aside, height));
      looked = {linear(held), range, bent(held)};
      keep_off_trunk(*grip.arm, looked.limb);
      std::vector<Form>& forms = looked.limb.needs.forms;
      forms.insert(forms.end(), goal.begin(), goal.end());
      add_last(held.last, forms);
      forms.erase(std::remove_if(forms.begin(), forms.end(), [](const Form& each) { return each.low() >= 0.0; }),
                  forms.end());
      limb.has[k] = cut_by(looked.limb.needs, looked.range) ? Limb::Has::Some : Limb::Has::None;
    }
    return limb.has[k] == Limb::Has::Some;
  }

  /// To where a limb has some option.
  bool cut_by_limb(const Body& body, const std::vector<Form>& goal, Limb& limb, Range<kVariables>& range) {
    std::optional<Range<kVariables>> left;
    for (std::size_t k = 0; k < limb.options.size() && !(left.has_value() && left->covers(range, kBody)); ++k) {
      if (has(body, goal, limb, k, range)) {
        left.has_value() ? left->widen(limb.looked[k].range) : void(left = limb.looked[k].range);
      }
    }
    return left.has_value() && narrow(*left, range);
  }

  /// To where two limbs have options that go together.
  bool cut_by_two(const Body& body, const std::vector<Form>& goal, Limb& first, Limb& second,
                  Range<kVariables>& range) {
    std::optional<Range<kVariables>> left;
    for (std::size_t k = 0; k < second.options.size(); ++k) {
      std::optional<Looked> other;
      for (std::size_t i = 0; i < first.options.size(); ++i) {
        const std::size_t one_grip = first.options[i].grip;
        const std::size_t other_grip = second.options[k].grip;
        if (together_[one_grip * count_ + other_grip] == 0 || !has(body, goal, first, i, range) ||
            !has(body, goal, second, k, range)) {
          continue;
        }
        if (!other.has_value()) {
          other = as_second(second.looked[k]);
        }
        const Looked& one = first.looked[i];
        Conditions<Form> needs{goal, {}};
        keep_apart(grips_[one_grip], grips_[other_grip], one.limb, other->limb, clear_m_, needs);
        if (needs.apart.empty()) {
          return true;
        }
        --looks_;
        for (const Looked* each : {&one, &std::as_const(*other)}) {
          const std::vector<Form>& forms = each->limb.needs.forms;
          needs.forms.insert(needs.forms.end(), forms.begin(), forms.end());
        }
        Range<kVariables> both = range;
        for (std::size_t v = kBody; v < kBody + 2; ++v) {
          both.low[v] = one.range.low[v];
          both.high[v] = one.range.high[v];
          both.low[v + 2] = other->range.low[v];
          both.high[v + 2] = other->range.high[v];
        }
        if (cut_by(needs, both)) {
          first.looked[i].meets = second.looked[k].meets = true;
          left.has_value() ? left->widen(both) : void(left = both);
          if (left->covers(range, kBody)) {
            return true;
          }
        }
      }
    }
    return left.has_value() && narrow(*left, range);
  }

  /// To the part of the body's variables that is in another range.
  static bool narrow(const Range<kVariables>& to, Range<kVariables>& range) {
    for (std::size_t i = 0; i < kBody; ++i) {
      range.low[i] = std::max(range.low[i], to.low[i]);
      range.high[i] = std::min(range.high[i], to.high[i]);
      if (range.low[i] > range.high[i]) {
        return false;
      }
    }
    return true;
  }

  /// Whether the middle of a box is a pose as asked for, with grippers in the middle of their places.
  [[nodiscard]] bool holds(const Box& box) const {
    std::array<double, kBody> body{};
    for (std::size_t i = 0; i < kBody; ++i) {
      body[i] = (box.low[i] + box.high[i]) / 2;
    }
    std::array<std::vector<Held>, kLimbs> held;
    const std::vector<double> goal = at_goal(goal_, body);
    bool all = met(goal);
    for (std::size_t limb = 0; limb < kLimbs; ++limb) {
      for (const Option& option : box.options[limb]) {
        const crux_refute_grip& grip = grips_[option.grip];
        const Vector wrist =
            wrist_on(grip, body, (option.low[0] + option.high[0]) / 2, (option.low[1] + option.high[1]) / 2);
        HeldLimb<double> each = held_limb<double>(grip, option.ahead, {body[3], body[4], body[5]}, wrist);
        keep_off_trunk(*grips_[option.grip].arm, each);
        if (met(each.needs.forms) && std::max(each.last[0], each.last[1]) >= 0.0) {
          held[limb].push_back({option.grip, std::move(each)});
        }
      }
      all = all && (box.options[limb].empty() || !held[limb].empty());
    }
    std::vector<const Held*> chosen;
    return all && choose(held, chosen, 0);
  }

  struct Held {
    std::size_t grip;
    HeldLimb<double> limb;
  };

  static bool met(const std::vector<double>& forms) {
    return std::all_of(forms.begin(), forms.end(), [](double each) { return each >= 0.0; });
  }

  /// Whether the limbs from one on can hold beside those chosen.
  [[nodiscard]] bool choose(const std::array<std::vector<Held>, kLimbs>& held, std::vector<const Held*>& chosen,
                            std::size_t limb) const {
    if (limb == kLimbs) {
      return true;
    }
    if (held[limb].empty()) {
      return choose(held, chosen, limb + 1);
    }
    for (const Held& each : held[limb]) {
      const bool free = std::all_of(chosen.begin(), chosen.end(), [&](const Held* other) {
        Conditions<double> needs;
        keep_apart(grips_[other->grip], grips_[each.grip], other->limb, each.limb, clear_m_, needs);
        return together_[other->grip * count_ + each.grip] != 0 && needs.apart.empty();
      });
      if (free) {
        chosen.push_back(&each);
        if (choose(held, chosen, limb + 1)) {
          return true;
        }
        chosen.pop_back();
      }
    }
    return false;
  }

  /// The most that an option's own place bends links that meet.
  static double bent_by_own(const Box& box) {
    double found = 0.0;
    for (const auto& options : box.options) {
      for (const Option& each : options) {
        found = std::max({found, each.bent[0], each.bent[1]});
      }
    }
    return found;
  }

  static bool tiny(const Box& box) {
    for (std::size_t i = 0; i < kBody; ++i) {
      if ((box.high[i] - box.low[i]) * kSizes[i] > kTiny) {
        return false;
      }
    }
    return true;
  }

  /// Adds the halves of a box; or the same with halves of options, where these matter more.
  static void halve(Box box, std::vector<Box>& to) {
    const auto most = std::max_element(box.bent.begin(), box.bent.end());
    const double own = bent_by_own(box);
    if (own > *most) {
      for (auto& options : box.options) {
        for (std::size_t k = options.size(); k-- > 0;) {
          const std::size_t i = options[k].bent[1] > options[k].bent[0] ? 1 : 0;
          if (options[k].bent[i] > own / 2) {
            Option upper = options[k];
            upper.low[i] = options[k].high[i] = (options[k].low[i] + options[k].high[i]) / 2;
            options.push_back(upper);
          }
        }
      }
      to.push_back(std::move(box));
      return;
    }
    const auto axis = static_cast<std::size_t>(most - box.bent.begin());
    Box upper = box;
    upper.low[axis] = box.high[axis] = (box.low[axis] + box.high[axis]) / 2;
    to.push_back(std::move(upper));
    to.push_back(std::move(box));
  }

  const crux_refute_goal& goal_;
  const crux_refute_grip* grips_;
  std::size_t count_;
  const std::uint8_t* together_;
  double clear_m_;
  std::int64_t looks_;
  double until_s_;
};

}  // namespace
}  // namespace crux

int64_t crux_refute(const crux_refute_goal* goal, const crux_refute_grip* grips, int64_t count, const uint8_t* together,
                    double clear_m, int64_t looks, double seconds) {
  return crux::Search(*goal, grips, static_cast<std::size_t>(count), together, clear_m, looks, seconds).answer();
}
