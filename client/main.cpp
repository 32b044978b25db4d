#include <CLI/CLI.hpp>
#include <csignal>

#include "client/program.h"

int main(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  tessera::client::Invocation invocation;
  CLI::App app;
  tessera::client::describe_program(app, invocation);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {  // CLI11 reports wrong usage, and --help, by throwing
    return app.exit(error) == 0 ? tessera::client::kExitDone : tessera::client::kExitBadInput;
  }
  return invocation.run();
}
