#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace tessera::client {

/// An option as --help shows it.
struct ShownOption {
  std::vector<std::string> names;  // as typed: "-o", "--output"
  std::string value;               // name of its value, e.g. "DIR"; empty: a flag
  std::string description;         // with conditions, e.g. "Threads (1 to 1024)"
  std::string default_value;       // empty: none
};

/// Returns the options of `app` that --help shows, without positional arguments, then those of its
/// option groups.
std::vector<ShownOption> shown_options(const CLI::App& app);

/// Returns the subcommands of `app` that --help shows, in the order of --help.
std::vector<const CLI::App*> shown_subcommands(const CLI::App& app);

}  // namespace tessera::client
