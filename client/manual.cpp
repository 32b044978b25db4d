#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <string>

#include "client/commands.h"
#include "client/completion.h"

// tessera-manual FOLDER: writes tessera.1 and tessera-COMMAND.1, read off the parser. Built by the
// target `man`; not installed.

namespace {

bool write_page(const CLI::App& command, const std::string& folder, const std::string& program) {
  std::string name = program;
  for (char& c : name) {
    if (c == ' ') c = '-';
  }
  std::ofstream file(folder + "/" + name + ".1");
  file << tessera::client::man_page(command, program);
  return static_cast<bool>(file.flush());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: tessera-manual FOLDER\n";
    return tessera::client::kExitBadInput;
  }
  tessera::client::Invocation invocation;
  CLI::App app("Renders glTF scenes on this machine or on a farm, the same bits either way.",
               "tessera");
  tessera::client::add_all_commands(app, invocation);
  bool written = write_page(app, argv[1], "tessera");
  for (const CLI::App* command : app.get_subcommands(nullptr)) {
    written = written && write_page(*command, argv[1], "tessera " + command->get_name());
  }
  if (!written) std::cerr << "tessera-manual: cannot write into " << argv[1] << "\n";
  return written ? tessera::client::kExitDone : tessera::client::kExitBadInput;
}
