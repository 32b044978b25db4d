#pragma once

#include <functional>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace tessera::server {

/// Adds init-certs, issue-cert, revoke and tokens. The selected one sets `run`, to be called after
/// parsing.
void add_identity_commands(CLI::App& app, std::function<absl::Status()>& run);

}  // namespace tessera::server
