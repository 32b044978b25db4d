#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace tessera::server {

/// Adds check. Sets `run`, to be called once parsing is over, if it is asked for.
void add_store_commands(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace tessera::server
