#pragma once

#include <memory>
#include <string>

namespace CLI {
class FormatterBase;
class Option;
}  // namespace CLI

namespace tessera::cli {

/// An option in words.
struct OptionText {
  std::string value;          // placeholder or choices: "N", "DIR", "warn|stop"; empty: a flag
  std::string description;    // with conditions, e.g. "Threads (1 to 1024; required)"
  std::string default_value;  // empty: none
};
OptionText option_text(const CLI::Option& option);

/// Returns the formatter of --help: an option's name and placeholder, its description, and in
/// parentheses its conditions and default. --help-all includes commands of commands.
std::shared_ptr<CLI::FormatterBase> help_formatter();

}  // namespace tessera::cli
