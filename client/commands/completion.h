#pragma once

#include <string>

#include "client/cli/command.h"

namespace tessera::client {

/// Returns the completion script of `shell` (bash, zsh or fish) for a command line. It is generated
/// from the parser, so it lists exactly the existing commands and options. Empty for another shell.
std::string completion_script(const CLI::App& app, const std::string& shell);

void add_completion_command(CLI::App& app, Invocation& invocation);

}  // namespace tessera::client
