#pragma once

#include "client/cli/command.h"

namespace tessera::client {

/// Adds the options of `tessera` itself and all commands to `app`.
void describe_program(CLI::App& app, Invocation& invocation);

/// Runs `tessera`: parses the command line and executes the command. Returns the exit code.
int run_program(int argc, char** argv);

}  // namespace tessera::client
