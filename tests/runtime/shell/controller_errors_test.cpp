// What the error frames of linux/can/error.h do to a bus's state and counts.
#include "bus/controller_errors.hpp"

#include <gtest/gtest.h>
#include <linux/can/error.h>

namespace crux {
namespace {

class ControllerErrorsTest : public ::testing::Test {
 protected:
  BusState after(canid_t classes, std::uint8_t controller_detail = 0) {
    canfd_frame frame{};
    frame.can_id = CAN_ERR_FLAG | classes;
    frame.len = CAN_ERR_DLC;
    frame.data[1] = controller_detail;
    errors_.take(frame, counts_);
    return errors_.state();
  }
  ControllerErrors errors_;
  BusStatistics counts_;
};

TEST_F(ControllerErrorsTest, ErrorPassiveLastsUntilTheCountersFall) {
  EXPECT_EQ(after(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING), BusState::kActive);
  EXPECT_EQ(after(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE), BusState::kPassive);
  EXPECT_EQ(after(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE), BusState::kPassive);
  EXPECT_EQ(counts_.error_passive, 1U) << "still the same passive phase";
  errors_.heard();
  EXPECT_EQ(errors_.state(), BusState::kPassive) << "traffic alone proves nothing";
  EXPECT_EQ(after(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING), BusState::kActive);
  after(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE);
  EXPECT_EQ(after(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE), BusState::kActive);
  EXPECT_EQ(counts_.error_passive, 2U);
  EXPECT_EQ(counts_.error_frames, 6U);
}

TEST_F(ControllerErrorsTest, BusOffLastsUntilTheRestart) {
  EXPECT_EQ(after(CAN_ERR_BUSOFF), BusState::kOff);
  EXPECT_EQ(after(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE), BusState::kOff);
  errors_.heard();
  EXPECT_EQ(errors_.state(), BusState::kOff);
  EXPECT_EQ(after(CAN_ERR_BUSOFF), BusState::kOff);
  EXPECT_EQ(counts_.bus_off, 1U);
  EXPECT_EQ(after(CAN_ERR_RESTARTED), BusState::kActive);
  EXPECT_EQ(counts_.restarts, 1U);
  EXPECT_EQ(after(CAN_ERR_BUSOFF), BusState::kOff);
  EXPECT_EQ(counts_.bus_off, 2U);
}

TEST_F(ControllerErrorsTest, AMissingAcknowledgementLastsUntilSomebodySpeaks) {
  EXPECT_EQ(after(CAN_ERR_ACK | CAN_ERR_BUSERROR), BusState::kUnacknowledged);
  EXPECT_EQ(after(CAN_ERR_CRTL | CAN_ERR_ACK, CAN_ERR_CRTL_TX_PASSIVE), BusState::kUnacknowledged);
  EXPECT_EQ(counts_.unacknowledged, 2U);
  errors_.heard();
  EXPECT_EQ(errors_.state(), BusState::kPassive);
}

TEST_F(ControllerErrorsTest, OtherErrorsAreCountedAndNoMore) {
  for (const canid_t kind : {CAN_ERR_TX_TIMEOUT, CAN_ERR_LOSTARB, CAN_ERR_PROT, CAN_ERR_TRX, CAN_ERR_BUSERROR})
    EXPECT_EQ(after(kind), BusState::kActive);
  EXPECT_EQ(counts_.error_frames, 5U);
  after(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW);
  EXPECT_EQ(counts_.receive_lost, 1U);
}

TEST_F(ControllerErrorsTest, AnInterfaceThatWasDownStartsAnew) {
  after(CAN_ERR_BUSOFF);
  errors_.reset();
  EXPECT_EQ(errors_.state(), BusState::kActive);
}

}  // namespace
}  // namespace crux
