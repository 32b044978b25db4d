#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <string>

#include "client/commands/commands.h"
#include "client/commands/completion.h"
#include "client/manual/pages.h"
#include "client/program.h"

// tessera_manual OUT SERVER WEBHOOK WORKER: writes what is generated from the tables of --help into
// the directory OUT: man pages (man/cli, man/server, man/worker), completions, and cli.md. The
// three programs are run for their --help-all. Run by the build; not installed.

namespace {

using tessera::client::markdown_section;
using tessera::client::markdown_section_of_help;

/// Ends the build with a message if the file cannot be written.
void write(const std::filesystem::path& path, const std::string& text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream file(path);
  if (file << text && file.flush()) return;
  std::cerr << "tessera_manual: " << path << " cannot be written\n";
  std::exit(1);
}

/// Returns the output of `program --help-all`. Ends the build with a message if it fails.
std::string help_of(const std::string& program) {
  std::FILE* pipe = ::popen(("'" + program + "' --help-all").c_str(), "r");
  std::string text;
  char buffer[4096];
  std::size_t size = 0;
  while (pipe != nullptr && (size = std::fread(buffer, 1, sizeof buffer, pipe)) > 0) {
    text.append(buffer, size);
  }
  if (pipe != nullptr && ::pclose(pipe) == 0 && !text.empty()) return text;
  std::cerr << "tessera_manual: " << program << " --help-all failed\n";
  std::exit(1);
}

std::string page_name(std::string program) {
  for (char& c : program) {
    if (c == ' ') c = '-';
  }
  return program + ".1";
}

/// Writes the man pages of `app` and its commands, and returns their sections of cli.md.
std::string write_client_pages(const CLI::App& app, const std::filesystem::path& man) {
  std::string sections;
  const auto add = [&](const CLI::App& command, const std::string& program) {
    write(man / page_name(program), tessera::client::man_page(command, program));
    sections += markdown_section(command, program);
  };
  add(app, "tessera");
  for (const CLI::App* command : app.get_subcommands(nullptr)) {
    const std::string program = "tessera " + command->get_name();
    add(*command, program);
    for (const CLI::App* each : command->get_subcommands(nullptr)) {
      sections += markdown_section(*each, program + " " + each->get_name());
    }
  }
  return sections;
}

constexpr const char* kHeading =
    "# Command line\n\n"
    "Every command and option of the four programs. This page is generated from the tables that\n"
    "`--help` prints; a test fails where they differ.\n\n";

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::cerr << "usage: tessera_manual OUT SERVER WEBHOOK WORKER\n";
    return 2;
  }
  const std::filesystem::path out = argv[1];
  tessera::client::Invocation invocation;
  setenv("XDG_CONFIG_HOME", "~/.config", 1);  // in the pages, not the directory of who builds them
  CLI::App app;
  tessera::client::describe_program(app, invocation);

  std::string markdown = kHeading + write_client_pages(app, out / "man/cli");
  const char* const components[] = {"server", "server", "worker"};
  for (int i = 0; i < 3; ++i) {
    const std::string program = argv[i + 2], help = help_of(program);
    const std::string name = program.substr(program.rfind('/') + 1);
    write(out / "man" / components[i] / page_name(name),
          tessera::client::man_page_of_help(name, help));
    markdown += markdown_section_of_help(name, help);
  }
  write(out / "cli.md", markdown.substr(0, markdown.size() - 1));
  write(out / "completions/tessera.bash", tessera::client::completion_script(app, "bash"));
  write(out / "completions/_tessera", tessera::client::completion_script(app, "zsh"));
  write(out / "completions/tessera.fish", tessera::client::completion_script(app, "fish"));
  return 0;
}
