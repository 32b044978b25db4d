#include "client/cli/config_file.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "tests/support/scratch_folder.h"

namespace tessera::client {
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

}  // namespace
}  // namespace tessera::client
