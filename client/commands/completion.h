#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::client {

/// Returns the completion script of `shell` (bash, zsh or fish) for a command line. It is generated
/// from the parser, so it lists exactly the existing commands and options. Empty for another shell.
std::string completion_script(const CLI::App& app, const std::string& shell);

}  // namespace tessera::client
