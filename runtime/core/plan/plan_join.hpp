// Plans in parts: one that goes on where another one ends becomes one plan with it.
#pragma once

#include <crux_msgs/plan_t.hpp>
#include <memory>
#include <string>

#include "core/plan/prepared_plan.hpp"

namespace crux {

/// Why `part` cannot begin in the stance in which `before` ends, both well in themselves. Empty when it can.
std::string join_defect(const crux_msgs::plan_t& before, const crux_msgs::plan_t& part);

/// Both as one plan, with an id of its own: the knots of `before` less its last one, then those of `part`, whose
/// scenario has the goal.
crux_msgs::plan_t joined(const crux_msgs::plan_t& before, const crux_msgs::plan_t& part);

/// The tables of `joined`, which say what they go on from. Its parts are valid by themselves, so it is not asked again.
std::unique_ptr<const PreparedPlan> prepare_joined(const crux_msgs::plan_t& before, const crux_msgs::plan_t& whole);

/// All of `running` comes first in `longer`: the clock may stand anywhere before the last interval of `running`.
bool extends(const PreparedPlan& longer, const PreparedPlan& running) noexcept;

}  // namespace crux
