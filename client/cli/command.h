#pragma once

#include <chrono>
#include <functional>
#include <string>

#include "absl/status/status.h"

namespace CLI {
class App;
}

namespace tessera::client {

/// Exit codes of every command (design.md, section 4).
inline constexpr int kExitDone = 0;
inline constexpr int kExitJobFailed = 1;    // or cancelled, or a comparison over its limit
inline constexpr int kExitBadInput = 2;     // wrong usage or bad input
inline constexpr int kExitUnreachable = 3;  // no farm there, or it refused us
inline constexpr int kExitUncertain = 4;    // files written, the error asked for is not certified
inline constexpr int kExitInterrupted = 130;

/// Where the farm is and how to enter it.
struct Connection {
  std::string server;      // unix:PATH or HOST:PORT; empty: default_server()
  std::string certs;       // folder of certificates; empty: none
  std::string token_file;  // file with the token; empty: TESSERA_TOKEN, which is the token itself
  std::chrono::seconds connect_timeout{2};  // with a farm that has not answered yet
};

/// What the command line asks for. A command's parser callback sets `run`; main calls it once
/// parsing is over, so that commands run outside CLI11 and return exit codes, never throw them.
struct Invocation {
  Connection connection;
  std::function<int()> run;
};

/// Adds --server, --certs and --token to a command. They write to `connection`, which the top level
/// has already filled from the config file and the environment.
void add_connection_options(CLI::App& command, Connection& connection);

/// Where the user's farm that stays (`tessera farm up`) has its socket: $XDG_RUNTIME_DIR/tessera,
/// else /tmp/tessera-UID. It need not be there.
std::string farm_folder();

/// Whether the path is a folder that only this user can enter.
bool is_private_folder(const std::string& path);

/// unix:FOLDER/server.sock, of farm_folder(), if that socket is there and nobody else could have
/// put it there, else 127.0.0.1:7420.
std::string default_server();

/// The exit code that stands for an error: 2 for what the user can mend in the request, 130 for
/// CANCELLED (interrupted), else 3.
int exit_code(const absl::Status& status);

/// Prints "tessera: MESSAGE" to stderr and returns exit_code(status).
int fail(const absl::Status& status);

}  // namespace tessera::client
