// The balance of the whole robot: what the F/T sensors feel on all holds, and the weight. Six rows for four sensors, so
// they detect; which sensor it is they tell only where a force at one limb alone explains all of it. What is there all
// the time along gravity is a load.
#pragma once

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

class WeightBalance {
 public:
  WeightBalance(const StanceParameters& parameters, const ForceTorqueDescription& sensor)
      : parameters_(parameters), doubt_N_(kLimbs * sensor.bias_N) {}

  /// Once a cycle. `felt_W`: wrench on each gripper about its centre, at `gripper_W_m`, of limbs in the air as well:
  /// one may touch something. `weight_W_N` acts at `com_W_m`.
  void update(const PerLimb<Wrench>& felt_W, const PerLimb<Vector3>& gripper_W_m, const Vector3& com_W_m,
              const Vector3& weight_W_N, double dt_s) noexcept;

  /// Sum of all about the centre of mass.
  const Wrench& unbalanced_W() const { return sum_W_; }
  /// What of it is not there all the time, as a force [N]: a payload and sensors' biases are learnt.
  double change_N() const { return change_N_; }
  /// The limb at which one force explains the change; -1 where none does, or several would.
  int limb() const { return limb_; }

  /// Once a cycle, after update(), while the robot hangs by its own grips and all sensors are believed.
  void weigh(const Vector3& weight_W_N, double dt_s) noexcept;

  /// What the robot carries, as a share of its described weight: the mean of what is felt along gravity beyond that
  /// weight, over about the last balance_memory_s, less what the sensors' biases together may make. 0..0.25.
  double carried() const { return carried_; }

  /// What is learnt from now on is there all the time; the load stays.
  void restart() noexcept { started_ = false; }
  void forget_load() noexcept { weighed_s_ = beyond_N_ = carried_ = 0.0; }

 private:
  int blame(const PerLimb<Vector3>& gripper_W_m, const Vector3& com_W_m, const Vector6& change) const noexcept;

  StanceParameters parameters_;
  double doubt_N_;
  Wrench sum_W_;
  Vector6 learnt_ = Vector6::Zero();  ///< force, and moment over the arm
  double change_N_ = 0.0;
  int limb_ = -1;
  double weighed_s_ = 0.0;  ///< at most balance_memory_s
  double beyond_N_ = 0.0;
  double carried_ = 0.0;
  bool started_ = false;
};

}  // namespace crux
