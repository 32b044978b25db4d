#include <CLI/CLI.hpp>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <string>

#include "client/commands/commands.h"
#include "client/commands/completion.h"

// tessera-manual FOLDER [PROGRAM…]: writes tessera.1 and tessera-COMMAND.1, read off the parser,
// and for each other program a page that holds what it prints for --help. Run by the target `man`;
// not installed.

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

/// What `program --help` prints; empty if it fails.
std::string help_of(const std::string& program) {
  std::FILE* pipe = ::popen(("'" + program + "' --help").c_str(), "r");
  if (pipe == nullptr) return "";
  std::string text;
  char buffer[4096];
  std::size_t size = 0;
  while ((size = std::fread(buffer, 1, sizeof buffer, pipe)) > 0) text.append(buffer, size);
  return ::pclose(pipe) == 0 ? text : "";
}

bool write_help_page(const std::string& program, const std::string& folder) {
  const std::string help = help_of(program);
  const std::string name = program.substr(program.rfind('/') + 1);
  std::ofstream file(folder + "/" + name + ".1");
  file << tessera::client::man_page_of_help(name, help);
  return !help.empty() && file.flush();
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::cerr << "usage: tessera-manual FOLDER [PROGRAM…]\n";
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
  for (int i = 2; i < argc; ++i) written = write_help_page(argv[i], argv[1]) && written;
  if (!written) std::cerr << "tessera-manual: some page could not be written\n";
  return written ? tessera::client::kExitDone : tessera::client::kExitBadInput;
}
