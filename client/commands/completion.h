#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::client {

/// The completion script of `shell` (bash, zsh or fish) for a command line, read off the parser
/// itself, so that it cannot list what is not there. Empty for another shell.
std::string completion_script(const CLI::App& app, const std::string& shell);

/// Man page of `command` (a subcommand, or the program itself), in roff, section 1, from its
/// --help. `program` is what it is called with, e.g. "tessera fetch".
std::string man_page(const CLI::App& command, const std::string& program);

/// Man page of another program, around the text it prints for --help.
std::string man_page_of_help(const std::string& name, const std::string& help);

}  // namespace tessera::client
