/// Models of a limb over boxes of poses, against the limb at poses drawn in them.
#include "held_limb.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <random>
#include <vector>

#include "affine.hpp"
#include "range.hpp"
#include "taylor.hpp"

namespace crux {
namespace {

constexpr std::size_t kVariables = 8;  // of the body, and the gripper's place
constexpr std::array<std::size_t, kVariables> kSlots{0, 1, 2, 3, 4, 5, 6, 7};
constexpr double kRounding = 1e-9;
using Model = Taylor<kVariables>;
using Form = Affine<kVariables>;

crux_reach_sector between(double low, double high) {
  const double middle = (low + high) / 2;
  return {std::cos(middle), std::sin(middle), std::cos((high - low) / 2)};
}

/// Like scaler's front left limb.
struct Example {
  std::vector<crux_reach_capsule> links{{{0, 0, 0}, {0.13, 0, 0}, 0.02, 0},
                                        {{0, 0, 0}, {0.13, 0.01, 0}, 0.02, 1},
                                        {{0.0, 0, -0.02}, {0, 0, 0.03}, 0.015, 3},
                                        {{0, 0, 0}, {0, 0, 0.05}, 0.02, 4}};
  std::vector<crux_reach_box> trunk{{{0, 0, 0}, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.1, 0.07, 0.03}}};
  crux_reach_arm arm{{0.12, 0.08, 0.0},
                     0.14,
                     0.16,
                     0.07,
                     0.0,
                     {-0.95, 0.95},
                     {-0.8, 0.8},
                     between(-0.6, 1.4),
                     between(-1.0, 1.5),
                     between(-1.5, 1.5),
                     0.0,
                     trunk.data(),
                     links.data(),
                     1,
                     4,
                     4};
  crux_refute_grip grip{0, &arm, 0.3, std::cos(1.2), {0.3, 0.2}, {0.6, 0.8}, 0.02, {0.02, 0.04}, 0.4};
};

template <class T>
HeldLimb<T> limb_at(const Example& example, double ahead, const std::array<T, kVariables>& at) {
  const std::array<T, kBody> body{at[0], at[1], at[2], at[3], at[4], at[5]};
  const Vec<T> wrist = wrist_on(example.grip, body, at[6], at[7]);
  return held_limb<T>(example.grip, ahead, {at[3], at[4], at[5]}, wrist);
}

double value(const Form& form, const std::array<double, kVariables>& shares) {
  double sum = form.middle;
  for (std::size_t i = 0; i < kVariables; ++i) {
    sum += form.slope[i] * shares[i];
  }
  return sum;
}

class Boxes : public testing::TestWithParam<double> {};

TEST_P(Boxes, HaveAllPosesOfALimb) {
  std::mt19937_64 random(static_cast<std::uint64_t>(GetParam() * 1e6));
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  const Example example;
  std::size_t compared = 0;
  for (int box = 0; box < 300; ++box) {
    std::array<double, kVariables> half{};
    std::array<Model, kVariables> at;
    for (std::size_t i = 0; i < kVariables; ++i) {
      half[i] = GetParam() * (share(random) + 1.0) * (i >= 3 && i < 6 ? 4.0 : 1.0);
      at[i] = Model(0.05 * share(random) + (i == 2 ? 0.18 : 0.0));
      at[i].slope[i] = half[i];
    }
    const double ahead = box % 2 == 0 ? 1.0 : -1.0;
    const HeldLimb<Model> all = limb_at(example, ahead, at);
    for (int pose = 0; pose < 20; ++pose) {
      std::array<double, kVariables> shares{};
      std::array<double, kVariables> there{};
      for (std::size_t i = 0; i < kVariables; ++i) {
        shares[i] = pose < 10 ? share(random) : std::copysign(1.0, share(random));
        there[i] = at[i].middle + shares[i] * half[i];
      }
      const HeldLimb<double> one = limb_at(example, ahead, there);
      if (one.needs.forms[0] < 0.0 || one.needs.forms[1] < 0.0) {
        continue;  // the elbow is beyond its limits: nothing is said there
      }
      const auto expect = [&](const Model& model, double number) {
        const Form form = model.linear<kVariables>(kSlots);
        EXPECT_LE(std::abs(number - value(form, shares)), form.rest + kRounding);
        ++compared;
      };
      for (std::size_t k = 0; k < one.needs.forms.size(); ++k) {
        expect(all.needs.forms[k], one.needs.forms[k]);
      }
      expect(all.last[0], one.last[0]);
      for (std::size_t k = 0; k < one.links.size(); ++k) {
        for (std::size_t a = 0; a < 3; ++a) {
          expect(all.links[k][0][a], one.links[k][0][a]);
          expect(all.links[k][1][a], one.links[k][1][a]);
        }
      }
    }
  }
  EXPECT_GT(compared, 10000U);
}

INSTANTIATE_TEST_SUITE_P(Small, Boxes, testing::Values(0.0005, 0.004));
INSTANTIATE_TEST_SUITE_P(Large, Boxes, testing::Values(0.02, 0.06));

TEST(Range, KeepsAllPlacesOffABox) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> share(-1.0, 1.0);
  int kept = 0;
  for (int box = 0; box < 400; ++box) {
    Apart<Affine<3>> apart{{}, {0.03, 0.0, 0.01 * (share(random) + 1.0)}, 0.02};
    for (Affine<3>& each : apart.point) {
      each = Affine<3>(0.04 * share(random));
      for (double& slope : each.slope) {
        slope = 0.02 * share(random);
      }
    }
    Range<3> range;
    const std::vector<Affine<3>> forms{squared_off(apart.point, apart.half) - apart.by_m * apart.by_m};
    const bool some = range.cut(forms) && range.cut(apart, forms);
    for (int k = 0; k < 200; ++k) {
      const Vector shares{share(random), share(random), share(random)};
      Vector point{};
      for (std::size_t a = 0; a < 3; ++a) {
        point[a] = apart.point[a].middle + dot(Vector(apart.point[a].slope), shares);
      }
      if (squared_off(point, apart.half) >= apart.by_m * apart.by_m) {
        ASSERT_TRUE(some);
        for (std::size_t i = 0; i < 3; ++i) {
          EXPECT_GE(shares[i], range.low[i] - kRounding);
          EXPECT_LE(shares[i], range.high[i] + kRounding);
        }
        ++kept;
      }
    }
  }
  EXPECT_GT(kept, 1000);
}

}  // namespace
}  // namespace crux
