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
  std::string description;
  std::string default_value;  // empty: none
};

/// The options of `app` that --help shows, without positional arguments, then those of its option
/// groups.
std::vector<ShownOption> shown_options(const CLI::App& app);

/// The subcommands of `app` that --help shows, in its order.
std::vector<const CLI::App*> shown_subcommands(const CLI::App& app);

}  // namespace tessera::client
