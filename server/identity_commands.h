#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace tessera::server {

/// Adds init-certs, issue-cert, revoke and tokens. The one that is asked for sets `run`, to be
/// called once parsing is over.
void add_identity_commands(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace tessera::server
