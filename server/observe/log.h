#pragma once

#include <functional>
#include <string>

namespace tessera::server {

/// A log on stderr: a line an event, with wall time. `level`: error, warn, info or debug (others
/// count as info). Thread-safe.
std::function<void(const std::string&)> open_log(const std::string& level);

}  // namespace tessera::server
