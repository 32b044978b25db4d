#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::client {

/// Returns the man page (section 1, in roff) of `command`, a subcommand or the program itself, from
/// the tables of --help. `program`: the words that call it, e.g. "tessera fetch".
std::string man_page(const CLI::App& command, const std::string& program);

/// Returns the man page of another program, from its output of --help-all.
std::string man_page_of_help(const std::string& name, const std::string& help);

/// Returns the section of docs/reference/cli.md for `command`, in Markdown, from the tables of
/// --help.
std::string markdown_section(const CLI::App& command, const std::string& program);

/// Returns the section of docs/reference/cli.md for another program, from its output of --help-all.
std::string markdown_section_of_help(const std::string& name, const std::string& help);

}  // namespace tessera::client
