#include "client/program.h"

#include <google/protobuf/stubs/common.h>
#include <grpcpp/grpcpp.h>
#include <openssl/crypto.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdlib>
#include <memory>
#include <string>

#include "cli/command_line.h"
#include "cli/config_file.h"
#include "cli/help_text.h"
#include "cli/version_text.h"
#include "client/commands/commands.h"
#include "image/codecs/library_versions.h"

namespace tessera::client {
namespace {

/// $XDG_CONFIG_HOME/tessera/config.toml, else ~/.config/tessera/config.toml; empty without a home.
std::string config_path() {
  if (const char* folder = std::getenv("XDG_CONFIG_HOME"); folder != nullptr && *folder != 0) {
    return std::string(folder) + "/tessera/config.toml";
  }
  const char* home = std::getenv("HOME");
  return home == nullptr ? "" : std::string(home) + "/.config/tessera/config.toml";
}

}  // namespace

void describe_program(CLI::App& app, Invocation& invocation) {
  app.name("tessera");
  app.formatter(cli::help_formatter());
  app.description("Renders glTF scenes on this machine or on a farm, with the same pixels.");
  app.add_option("--server", invocation.connection.server, "Default of every --server")
      ->envname("TESSERA_SERVER")
      ->group("");
  app.add_option("--certs", invocation.connection.certs, "Default of every --certs")
      ->envname("TESSERA_CERTS")
      ->group("");
  app.add_option("--token", invocation.connection.token_file, "Default of every --token")
      ->group("");
  app.set_config("--config", config_path(),
                 "TOML file with default options, e.g. server = \"…\" or [render] spp = 256");
  app.config_formatter(std::make_shared<cli::ConfigFile>(app));
  app.set_version_flag(
      "--version",
      cli::version_text(
          "tessera", TESSERA_VERSION, cli::kBaselineIsa,
          {{"gRPC", grpc::Version()},
           {"protobuf", google::protobuf::internal::VersionString(GOOGLE_PROTOBUF_VERSION)},
           {"OpenSSL", OpenSSL_version(OPENSSL_VERSION_STRING)}},
          image::library_versions()));
  app.require_subcommand(1);
  app.footer(
      "Examples:\n"
      "  tessera render scene.glb -o out.exr --spp 256\n"
      "  tessera submit scene.glb --frames 0-99 --wait\n"
      "  tessera watch last");
  add_all_commands(app, invocation);
}

int run_program(int argc, char** argv) {
  std::signal(SIGPIPE, SIG_IGN);
  Invocation invocation;
  CLI::App app;
  describe_program(app, invocation);
  if (const auto ended = cli::parse(app, argc, argv)) return *ended;
  return invocation.run();
}

}  // namespace tessera::client
