#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

/// What the programs that stay say on stderr while they run: the same lines and the same levels in
/// each.
namespace tessera {

/// debug: what is routine, unit by unit; info: jobs, frames and workers come and go; warn:
/// something failed and the farm goes on; error: a store, a film or a worker does not do what it
/// must.
enum class LogLevel : std::uint8_t { debug, info, warn, error };

/// Writes one line. Thread-safe.
using Log = std::function<void(LogLevel, const std::string&)>;

/// Says nothing.
inline void no_log(LogLevel, const std::string&) {}

/// What `--log-level` takes.
std::vector<std::string> log_level_names();
/// The level of that name; of others info.
LogLevel log_level(const std::string& name);

/// A log on stderr: a line an event, with wall time, `program` and level. `level`, the least that
/// is written, is one of log_level_names() (others count as info).
Log open_log(const std::string& program, const std::string& level);

}  // namespace tessera
