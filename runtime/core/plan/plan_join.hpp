// Plans in parts: one that goes on from a stance of another one becomes one plan with it, up to that stance the
// other's.
#pragma once

#include <crux_msgs/plan_t.hpp>
#include <memory>
#include <string>

#include "core/plan/prepared_plan.hpp"

namespace crux {

/// The knot of `before` with which `part` begins, both well in themselves: the last one with that body and all limbs on
/// those holds, if grips may be where they were found instead. -1: none.
int join_knot(const crux_msgs::plan_t& before, const crux_msgs::plan_t& part);

/// Why `part` begins in no stance of `before`, as seen from its end. Empty when it does.
std::string join_defect(const crux_msgs::plan_t& before, const crux_msgs::plan_t& part);

/// Both as one plan, with an id of its own: the knots of `before` up to the one with which `part` begins, then those of
/// `part`, whose scenario has the goal. Grips that `part` begins with are where it has them for as long as they last.
crux_msgs::plan_t joined(const crux_msgs::plan_t& before, const crux_msgs::plan_t& part);

/// The tables of `joined`, which say what they go on from. Its parts are valid by themselves, so it is not asked again.
std::unique_ptr<const PreparedPlan> prepare_joined(const crux_msgs::plan_t& before, const crux_msgs::plan_t& whole);

/// Intervals from the first that both plans have, but for where grips are. The body's way through the last of them
/// depends on what comes after it.
int shared_intervals(const PreparedPlan& one, const PreparedPlan& other) noexcept;

/// Whether a limb that holds on is elsewhere at knot k of one plan than of another.
bool grips_elsewhere(const PreparedPlan& one, const PreparedPlan& other, int k, int limb) noexcept;

}  // namespace crux
