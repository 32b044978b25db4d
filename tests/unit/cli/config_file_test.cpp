#include "cli/config_file.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/scratch_folder.h"

namespace tessera::cli {
namespace {

/// The server that a command line, TESSERA_TEST_SERVER and a configuration file result in.
std::string chosen_server(std::vector<std::string> arguments, const char* environment) {
  const ScratchFolder folder;
  const std::string path = folder.path() + "/config.toml";
  std::ofstream(path) << "server = \"file\"\n";
  ::unsetenv("TESSERA_TEST_SERVER");
  if (environment != nullptr) ::setenv("TESSERA_TEST_SERVER", environment, 1);
  CLI::App app;
  std::string server;
  app.add_option("--server", server)->envname("TESSERA_TEST_SERVER");
  app.set_config("--config", path);
  app.config_formatter(std::make_shared<ConfigFile>(app));
  app.parse(arguments);
  return server;
}

TEST(ConfigFile, EnvironmentTakesPrecedenceOverFile) {
  EXPECT_EQ(chosen_server({}, nullptr), "file");
  EXPECT_EQ(chosen_server({}, "environment"), "environment");
}

TEST(ConfigFile, CommandLineTakesPrecedenceOverAll) {
  EXPECT_EQ(chosen_server({"typed", "--server"}, "environment"),
            "typed");  // CLI11 pops from the back
}

/// The message of the error for a file with `lines`, without its path; empty if there is none.
std::string error_of(const std::string& lines) {
  const ScratchFolder folder;
  const std::string path = folder.path() + "/config.toml";
  std::ofstream(path) << lines;
  CLI::App app;
  std::string text;
  app.add_option("--server", text);
  CLI::App* render = app.add_subcommand("render");
  render->add_option("--spp", text);
  render->add_option("--size", text);
  app.set_config("--config", path);
  app.config_formatter(std::make_shared<ConfigFile>(app));
  try {
    app.parse(std::vector<std::string>());
  } catch (const CLI::ConfigError& error) {
    const std::string message = error.what();
    return message.substr(0, path.size()) == path ? message.substr(path.size()) : message;
  }
  return "";
}

TEST(ConfigFile, UnknownKeyIsAnErrorWithNearestName) {
  EXPECT_EQ(error_of("sever = \"x\"\n"), ": unknown key sever; did you mean server?");
  EXPECT_EQ(error_of("[render]\nssp = 4\n"), ": unknown key ssp in [render]; did you mean spp?");
}

TEST(ConfigFile, KeyOfAnotherTableIsAnError) {
  EXPECT_EQ(error_of("spp = 4\n"), ": unknown key spp");
  EXPECT_EQ(error_of("[render]\nserver = \"x\"\n"), ": unknown key server in [render]");
}

TEST(ConfigFile, UnknownTableIsAnErrorWithNearestName) {
  EXPECT_EQ(error_of("[rendr]\nspp = 4\n"), ": unknown table [rendr]; did you mean [render]?");
  EXPECT_EQ(error_of("[elsewhere]\nspp = 4\n"), ": unknown table [elsewhere]");
}

TEST(ConfigFile, KnownKeysAndTablesAreAccepted) {
  EXPECT_EQ(error_of("server = \"x\"\n[render]\nspp = 4\nsize = \"8x8\"\n"), "");
}

}  // namespace
}  // namespace tessera::cli
