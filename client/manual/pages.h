#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::client {

/// Man page of `command` (a subcommand or the program itself), in roff, section 1, from the tables
/// of --help. `program` is how it is called, e.g. "tessera fetch".
std::string man_page(const CLI::App& command, const std::string& program);

/// Man page of another program, around the text that it prints for --help-all.
std::string man_page_of_help(const std::string& name, const std::string& help);

/// Section of docs/reference/cli.md for `command`, in Markdown, from the tables of --help.
std::string markdown_section(const CLI::App& command, const std::string& program);

/// Section of docs/reference/cli.md for another program, around its --help-all.
std::string markdown_section_of_help(const std::string& name, const std::string& help);

}  // namespace tessera::client
