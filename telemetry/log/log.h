#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

// Logging of the server, worker and webhook programs: one format and one set of levels.
namespace tessera {

/// debug: routine, per unit; info: changes of jobs, frames and workers; warn: a recoverable
/// failure; error: the store, the film or a worker does not work.
enum class LogLevel : std::uint8_t { debug, info, warn, error };

/// Writes a line. Thread-safe.
using Log = std::function<void(LogLevel, const std::string&)>;

/// Discards all lines.
inline void no_log(LogLevel, const std::string&) {}

/// Values of `--log-level`.
std::vector<std::string> log_level_names();
/// Returns the level of that name; info for unknown names.
LogLevel log_level(const std::string& name);

/// Returns a log on stderr: one line per event, with wall time, `program` and level; control
/// characters of the message are escaped. `level` is the
/// minimum level written, one of log_level_names() (others count as info).
Log open_log(const std::string& program, const std::string& level);

}  // namespace tessera
