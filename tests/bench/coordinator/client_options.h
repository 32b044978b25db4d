#pragma once

#include <CLI/CLI.hpp>
#include <string>

namespace tessera::bench {

/// Adds the options of a bench whose clients call a server without certificates.
inline void add_server_options(CLI::App& app, std::string& server, std::string& token) {
  app.add_option("--server", server, "unix:PATH or HOST:PORT")->required();
  app.add_option("--token", token, "the server's token");
}

}  // namespace tessera::bench
