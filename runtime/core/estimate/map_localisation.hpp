// Where the map of the holds lies in the world the estimate counts in. The stance tells how the body moves from grasp
// to grasp, but what the pads give under load is carried on from hold to hold. Three measurements know better: a
// gripper that has closed is centred on its hold along the opening axis, one that touches the wall is at its height,
// and the contact forces together bear the weight, straight down.
#pragma once

#include "core/robot/geometry.hpp"
#include "core/robot/robot_description.hpp"

namespace crux {

/// Kalman filter over the small rigid motion x = (t, θ) from the estimated to the true place of the body: a point that
/// is estimated at p is truly at p + t + θ × (p − r), r the body's position. Axes of W.
class MapLocalisation {
 public:
  explicit MapLocalisation(const LocalisationParameters& parameters) : parameters_(parameters) {}

  /// The body's pose was fitted to grippers at `arm_W_m` from the body, on holds of the map, wherever `on_hold`.
  void begin(const Vector3& body_W_m, const PerLimb<Vector3>& arm_W_m, const PerLimb<bool>& on_hold) noexcept;

  bool begun() const { return !covariance_.isZero(); }

  /// Takes in a cycle's contact forces, those of all limbs that touch a hold. `known`: their sensors' biases have been
  /// learnt.
  void feel(const Vector3& force_W_N, const Vector3& weight_W_N, bool known, double dt_s) noexcept;

  /// A gripper at `arm_W_m` from the body has closed and is `offset_m` off the planned place along `axis_W`. One more
  /// grasp's errors are added before; what was felt since the last grasp is taken in as well.
  void grasp(const Vector3& body_W_m, const Vector3& arm_W_m, const Vector3& axis_W, double offset_m) noexcept;

  /// A gripper at `arm_W_m` from the body is `offset_m` higher than a touch of the wall, or of its hold's top, makes
  /// it.
  void touch(const Vector3& body_W_m, const Vector3& arm_W_m, double offset_m) noexcept;

  /// Whether the body's height off the wall is so little known that a gripper should touch.
  bool unsure_of_height() const noexcept;

  /// What of the estimate's motion is due in this cycle, as a motion of W about `body_W_m`. Takes it off the rest.
  Pose correction(const Vector3& body_W_m, double dt_s) noexcept;

  const Vector6& pending() const { return pending_; }
  const Matrix6& covariance() const { return covariance_; }

 private:
  void carry_to(const Vector3& body_W_m) noexcept;
  void take_tilt() noexcept;
  void take(const Vector6& direction, double value, double sigma) noexcept;

  LocalisationParameters parameters_;
  Matrix6 covariance_ = Matrix6::Zero();
  Vector6 pending_ = Vector6::Zero();   ///< known, not yet applied
  Vector3 body_W_m_ = Vector3::Zero();  ///< r of the covariance
  Vector3 felt_ = Vector3::Zero();      ///< ∫ ΣF dt of the time that counts
  Vector3 weight_W_N_ = Vector3::Zero();
  double felt_s_ = 0.0;
};

}  // namespace crux
