// Where a run's log goes, and what it says of the run.
#pragma once

#include <memory>
#include <string>

#include "app/options.hpp"
#include "telemetry/mcap_log.hpp"

namespace crux {

/// Of this program: version and the commit it was built from.
std::string version();

/// The log of `options`, with the run's metadata and the robot description in it; null when none is wanted. A log that
/// is there already stays: the new one gets a number behind its name, which is told on standard error.
/// @throws LogError
std::unique_ptr<McapLog> open_log(const Options& options, const RobotDescription& robot);

/// What a log says of its end.
Metadata end_of(const CycleReport& report);

}  // namespace crux
