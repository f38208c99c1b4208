// LCM and CDR of every message type say the same in C++ as in Python.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "crux_msgs/cdr.hpp"
#include "golden_vectors.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;

template <class Message>
Bytes lcm_bytes(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  EXPECT_EQ(message.encode(bytes.data(), 0, static_cast<int>(bytes.size())), static_cast<int>(bytes.size()));
  return bytes;
}

template <class Message>
Bytes cdr_bytes(const Message& message) {
  Bytes bytes(crux_msgs::cdr_size(message));
  EXPECT_EQ(crux_msgs::encode_cdr(message, bytes), bytes.size());
  return bytes;
}

template <class Message>
class MessageGolden : public testing::Test {
 public:
  /// (LCM, CDR) of each golden vector of the type.
  static std::vector<std::pair<Bytes, Bytes>> vectors() {
    std::vector<std::pair<Bytes, Bytes>> found;
    for (const auto& vector : crux_test::golden("messages.json")) {
      if (vector["type"] != Message::getTypeName()) continue;
      found.emplace_back(crux_test::bytes_of(vector["lcm"]), crux_test::bytes_of(vector["cdr"]));
    }
    return found;
  }
};

using AllTypes = testing::Types<crux_msgs::acknowledgement_t, crux_msgs::answer_t, crux_msgs::bus_health_t,
                                crux_msgs::can_frames_t, crux_msgs::command_t, crux_msgs::control_input_t,
                                crux_msgs::control_output_t, crux_msgs::cycle_timing_t, crux_msgs::fault_t,
                                crux_msgs::hold_t, crux_msgs::limb_knot_t, crux_msgs::limb_reference_t,
                                crux_msgs::limb_telemetry_t, crux_msgs::plan_knot_t, crux_msgs::plan_piece_t,
                                crux_msgs::plan_t, crux_msgs::robot_state_t, crux_msgs::signed_t, crux_msgs::status_t,
                                crux_msgs::truth_body_t, crux_msgs::truth_contacts_t, crux_msgs::truth_verdict_t>;
TYPED_TEST_SUITE(MessageGolden, AllTypes);

TYPED_TEST(MessageGolden, LcmToCdrAndBack) {
  const auto vectors = TestFixture::vectors();
  ASSERT_FALSE(vectors.empty());
  for (const auto& [lcm, cdr] : vectors) {
    TypeParam from_lcm;
    ASSERT_EQ(from_lcm.decode(lcm.data(), 0, static_cast<int>(lcm.size())), static_cast<int>(lcm.size()));
    EXPECT_EQ(cdr_bytes(from_lcm), cdr);
    TypeParam carefully;
    ASSERT_TRUE(crux_msgs::decode_lcm(lcm, carefully));
    EXPECT_EQ(cdr_bytes(carefully), cdr);
    TypeParam from_cdr;
    ASSERT_TRUE(crux_msgs::decode_cdr(cdr, from_cdr));
    EXPECT_EQ(lcm_bytes(from_cdr), lcm);
  }
}

TYPED_TEST(MessageGolden, BuffersTooSmallAndBytesCutShortAreRefused) {
  for (const auto& [lcm, cdr] : TestFixture::vectors()) {
    TypeParam message;
    ASSERT_TRUE(crux_msgs::decode_cdr(cdr, message));
    for (std::size_t size = 0; size < cdr.size(); ++size) {
      Bytes small(size);
      EXPECT_EQ(crux_msgs::encode_cdr(message, small), 0U);
      TypeParam scratch;
      EXPECT_FALSE(crux_msgs::decode_cdr(std::span(cdr).first(size), scratch));
    }
    for (std::size_t size = 0; size < lcm.size(); ++size) {
      TypeParam scratch;
      EXPECT_FALSE(crux_msgs::decode_lcm(std::span(lcm).first(size), scratch));
    }
    Bytes longer = cdr;
    longer.push_back(0);
    EXPECT_FALSE(crux_msgs::decode_cdr(longer, message));
  }
}

TYPED_TEST(MessageGolden, DamagedBytesNeverCrash) {
  // Every byte set to 0x00, 0x7F, 0x80 and 0xFF in turn: lengths become huge, negative or zero.
  for (const auto& [lcm, cdr] : TestFixture::vectors()) {
    for (const std::uint8_t value : {0x00, 0x7F, 0x80, 0xFF}) {
      for (std::size_t i = 0; i < cdr.size(); ++i) {
        Bytes damaged = cdr;
        damaged[i] = value;
        TypeParam scratch;
        if (crux_msgs::decode_cdr(damaged, scratch)) {
          EXPECT_EQ(cdr_bytes(scratch).size(), damaged.size());
        }
      }
      for (std::size_t i = 0; i < lcm.size(); ++i) {
        Bytes damaged = lcm;
        damaged[i] = value;
        TypeParam scratch;
        if (crux_msgs::decode_lcm(damaged, scratch)) {
          EXPECT_EQ(lcm_bytes(scratch).size(), damaged.size());
        }
      }
    }
  }
}

TEST(MessageGoldenValues, FieldsHaveTheValuesThatPythonGaveThem) {
  for (const auto& vector : crux_test::golden("messages.json")) {
    if (vector["type"] != "plan_t" || vector["fields"]["n_knots"] == 0) continue;
    crux_msgs::plan_t plan;
    ASSERT_TRUE(crux_msgs::decode_cdr(crux_test::bytes_of(vector["cdr"]), plan));
    const auto& fields = vector["fields"];
    EXPECT_EQ(plan.format, fields["format"].get<int>());
    EXPECT_EQ(plan.scenario_name, fields["scenario_name"].get<std::string>());
    EXPECT_EQ(plan.dt_s, fields["dt_s"].get<double>());
    ASSERT_EQ(plan.holds.size(), 3U);
    EXPECT_EQ(plan.holds[2].name, fields["holds"][2]["name"].get<std::string>());
    EXPECT_EQ(plan.holds[1].spines[4], fields["holds"][1]["spines"][4].get<int>());
    ASSERT_EQ(plan.knots.size(), 3U);
    const auto& limb = fields["knots"][2]["limbs"][3];
    EXPECT_EQ(plan.knots[2].limbs[3].hold, limb["hold"].get<int>());
    for (int i = 0; i < 6; ++i) {
      EXPECT_EQ(plan.knots[2].limbs[3].finger_moment_w_nm[i],
                limb["finger_moment_w_nm"][static_cast<std::size_t>(i)].get<double>());
    }
    return;
  }
  FAIL() << "no plan among the vectors";
}

}  // namespace
