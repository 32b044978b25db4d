#include "cli/command_line.h"

#include <CLI/CLI.hpp>

#include "cli/exit_codes.h"

namespace tessera::cli {

std::optional<int> parse(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {  // CLI11 reports wrong usage, and --help, by throwing
    return app.exit(error) == 0 ? kExitDone : kExitBadInput;
  }
  return std::nullopt;
}

}  // namespace tessera::cli
