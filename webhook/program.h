#pragma once

namespace tessera::client {

/// Runs `tessera-webhook`: parses the command line and posts the events of a farm to an HTTP
/// address until it is stopped. Returns the exit code.
int run_webhook(int argc, char** argv);

}  // namespace tessera::client
