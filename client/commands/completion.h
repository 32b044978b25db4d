#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::client {

/// The completion script of `shell` (bash, zsh or fish) for a command line, read off the parser
/// itself, so that it cannot list what does not exist. Empty for another shell.
std::string completion_script(const CLI::App& app, const std::string& shell);

}  // namespace tessera::client
