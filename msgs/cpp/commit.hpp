// The commit that this was built from: twelve digits, with -dirty where a tracked file differed; or "unknown".
#pragma once

namespace crux_msgs {

extern const char* const kCommit;

}  // namespace crux_msgs
