#pragma once

#include "client/cli/command.h"

namespace tessera::client {

/// Adds the options of `tessera` itself and all commands to `app`.
void describe_program(CLI::App& app, Invocation& invocation);

}  // namespace tessera::client
