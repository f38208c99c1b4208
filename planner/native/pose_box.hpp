/// A box of body poses, and the options of limbs in it.
#ifndef CRUX_PLANNER_POSE_BOX_HPP
#define CRUX_PLANNER_POSE_BOX_HPP

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>
#include <vector>

#include "affine.hpp"
#include "held_limb.hpp"
#include "range.hpp"
#include "taylor.hpp"

namespace crux {

constexpr std::size_t kLimbs = 4;
constexpr std::size_t kVariables = kBody + 4;  ///< and of two limbs, how far aside and how high the gripper is

using Form = Affine<kVariables>;
using Model = Taylor<kBody + 2>;  ///< over the body and one limb's own place
using Body = std::array<Model, kBody>;
constexpr std::array<std::size_t, kBody + 2> kSlots{0, 1, 2, 3, 4, 5, 6, 7};

struct Option {
  std::size_t grip;
  double ahead;                     ///< as in `arm_posture`
  std::array<double, 2> low, high;  ///< how far aside and how high
  std::array<double, 2> bent{};     ///< [m] what these make of how far the links of two limbs are from linear
};

struct Box {
  std::array<double, kBody> low, high;
  std::array<std::vector<Option>, kLimbs> options;
  std::array<double, kBody> bent{};  ///< as that of options
};

/// An option over a box, and what is left of both.
struct Looked {
  HeldLimb<Form> limb;
  Range<kVariables> range;
  std::array<double, kBody + 2> bent{};
  bool meets = false;  ///< another limb's links
};

/// The options of one limb in a box, looked at when they are asked for.
struct Limb {
  enum class Has { Unknown, Some, None };

  std::vector<Option> options;
  std::vector<Has> has;
  std::vector<Looked> looked;

  explicit Limb(std::vector<Option> all)
      : options(std::move(all)), has(options.size(), Has::Unknown), looked(options.size()) {}
};

inline Model model(double low, double high, std::size_t slot) {
  Model made((low + high) / 2);
  made.slope[slot] = (high - low) / 2;
  return made;
}

/// The ends of a part of low..high, by its share of -1..1.
inline void keep(double& low, double& high, double from, double to) {
  const double middle = (low + high) / 2;
  const double half = (high - low) / 2;
  low = std::max(low, middle + from * half);
  high = std::min(high, middle + to * half);
}

inline std::vector<Form> linear(const std::vector<Model>& models) {
  std::vector<Form> made;
  for (const Model& each : models) {
    made.push_back(each.linear<kVariables>(kSlots));
  }
  return made;
}
inline HeldLimb<Form> linear(const HeldLimb<Model>& limb) {
  HeldLimb<Form> made;
  made.needs.forms = linear(limb.needs.forms);
  for (const auto& [start, end] : limb.links) {
    std::array<Vec<Form>, 2> link;
    for (std::size_t a = 0; a < 3; ++a) {
      link[0][a] = start[a].linear<kVariables>(kSlots);
      link[1][a] = end[a].linear<kVariables>(kSlots);
    }
    made.links.push_back(link);
  }
  return made;
}

/// How far each variable makes a limb's links from linear.
inline std::array<double, kBody + 2> bent(const HeldLimb<Model>& limb) {
  std::array<double, kBody + 2> most{};
  for (const auto& [start, end] : limb.links) {
    for (const Vec<Model>* point : {&start, &end}) {
      std::array<double, kBody + 2> here{};
      for (const Model& each : *point) {
        each.add_bent(here);
      }
      for (std::size_t i = 0; i < most.size(); ++i) {
        most[i] = std::max(most[i], here[i]);
      }
    }
  }
  return most;
}

/// The same limb with its own variables in the last slots.
inline void as_second(Form& each) {
  for (std::size_t i = kBody; i < kBody + 2; ++i) {
    std::swap(each.slope[i], each.slope[i + 2]);
  }
}
inline Looked as_second(Looked looked) {
  const auto each_of = [](Vec<Form>& point) {
    for (Form& each : point) {
      as_second(each);
    }
  };
  std::for_each(looked.limb.needs.forms.begin(), looked.limb.needs.forms.end(), [](Form& each) { as_second(each); });
  for (Apart<Form>& each : looked.limb.needs.apart) {
    each_of(each.point);
  }
  for (auto& [start, end] : looked.limb.links) {
    each_of(start);
    each_of(end);
  }
  return looked;
}

/// What joint 6 needs, where fingers may be one way round alone.
inline void add_last(const std::array<Model, 2>& last, std::vector<Form>& forms) {
  const std::array<Form, 2> either{last[0].linear<kVariables>(kSlots), last[1].linear<kVariables>(kSlots)};
  if (std::min(either[0].high(), either[1].high()) < -kForgiven) {
    forms.push_back(either[0].high() > either[1].high() ? either[0] : either[1]);
  }
}

inline bool cut_by(const Conditions<Form>& needs, Range<kVariables>& range) {
  return range.cut(needs.forms) && std::all_of(needs.apart.begin(), needs.apart.end(),
                                               [&](const Apart<Form>& each) { return range.cut(each, needs.forms); });
}

}  // namespace crux

#endif
