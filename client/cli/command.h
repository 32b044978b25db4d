#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "client/cli/exit_codes.h"

namespace CLI {
class App;
}

namespace tessera::client {

/// Address and credentials of a server.
struct Connection {
  std::string server;      // unix:PATH or HOST:PORT; empty: default_server()
  std::string certs;       // directory of certificates; empty: no TLS
  std::string token_file;  // file with the token; empty: the token is in TESSERA_TOKEN
  std::chrono::seconds connect_timeout{2};  // for the first answer
};

/// A parsed command line. The parser callback of a command sets `run`, and main calls it after
/// parsing, so that commands run outside CLI11 and return their exit code.
struct Invocation {
  Connection connection;
  std::function<int()> run;
};

/// Adds --server, --certs and --token to a command. They overwrite `connection`, which already
/// holds the values of the configuration file and the environment.
void add_connection_options(CLI::App& command, Connection& connection);

/// Adds the required argument that names a job; see FarmClient::get_job().
void add_job_argument(CLI::App& command, std::string& job);

/// Returns the directory of the socket of the user's persistent farm (`tessera farm up`):
/// $XDG_RUNTIME_DIR/tessera, else /tmp/tessera-UID. It may not exist.
std::string farm_folder();

/// Returns whether `path` is a directory that only this user can access.
bool is_private_folder(const std::string& path);

/// Returns unix:DIR/server.sock with DIR = farm_folder() if that socket exists and only this user
/// can have created it, else 127.0.0.1:7420.
std::string default_server();

/// Prints "tessera: MESSAGE" to stderr and returns exit_code(status.code()).
int fail(const absl::Status& status);

/// Flushes the output and ends the program without closing its connections, because closing takes
/// as long as a short command. Returns normally in builds that check for leaks or measure coverage.
void exit_at_once(int code);

}  // namespace tessera::client
