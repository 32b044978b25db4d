#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::client {

/// The completion script of `shell` (bash, zsh or fish) for a command line, read off the parser
/// itself, so that it cannot list what is not there. Empty for another shell.
std::string completion_script(const CLI::App& app, const std::string& shell);

}  // namespace tessera::client
