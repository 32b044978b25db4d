#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace tessera::server {

/// debug: what is routine, unit by unit; info: jobs, frames and workers come and go; warn:
/// something failed and the farm goes on; error: the store or the film does not do what it must.
enum class LogLevel : std::uint8_t { debug, info, warn, error };

using Log = std::function<void(LogLevel, const std::string&)>;

/// A log on stderr: a line an event, with wall time and level. `level`, the least that is written:
/// error, warn, info or debug (others count as info). Thread-safe.
Log open_log(const std::string& level);

}  // namespace tessera::server
