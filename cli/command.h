#pragma once

#include <string>

namespace CLI {
class App;
}

namespace tessera::cli {

/// Adds the subcommand `name` to `app`, which owns it. Defined out of line: CLI::App is a class of
/// inline functions, and every file that constructs one compiles all of them again, for seconds.
CLI::App* add_command(CLI::App& app, const std::string& name, const std::string& description);

}  // namespace tessera::cli
