// LCM's time to live bounds how far a message goes, not from where one comes.
#pragma once

#include <string>

namespace crux {

/// Where `url` is udpm:// with ttl=0, lets the receiving socket that this process has at it, which LCM keeps to itself,
/// take only what was sent on this machine (network namespace). Call it after the first subscription.
/// @returns what could not be done, empty when it is done or not wanted
std::string hear_only_this_machine(const std::string& url);

}  // namespace crux
