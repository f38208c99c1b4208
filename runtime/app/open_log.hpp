// Where a run's log goes, and what it says of the run.
#pragma once

#include <memory>
#include <string>

#include "app/options.hpp"
#include "telemetry/log_source.hpp"

namespace crux {

/// Of this program: version and the commit it was built from.
std::string version();

/// A new log with the run's metadata and the robot description in it.
/// @throws LogError
std::unique_ptr<McapLog> begin_log(const std::string& path, const Options& options, const RobotDescription& robot,
                                   const LogBeginning& beginning);

/// The log of `options`; null when none is wanted. A log that is there already stays: the new one gets a number behind
/// its name, which is told on standard error. Where it cannot be written no file of its name is left.
/// @throws LogError
std::unique_ptr<McapLog> open_log(const Options& options, const RobotDescription& robot);

/// What a log says of its end.
Metadata end_of(const CycleReport& report);

}  // namespace crux
