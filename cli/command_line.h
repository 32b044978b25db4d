#pragma once

#include <optional>

namespace CLI {
class App;
}

namespace tessera::cli {

/// Parses the command line of a program. Returns the exit code if the program ends with that:
/// kExitDone after --help or --version, kExitBadInput for wrong usage (reported on stderr).
std::optional<int> parse(CLI::App& app, int argc, char** argv);

}  // namespace tessera::cli
