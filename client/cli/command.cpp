#include "client/cli/command.h"

#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>

#include "absl/strings/str_cat.h"

namespace tessera::client {

void add_connection_options(CLI::App& command, Connection& connection) {
  command.add_option("--server", connection.server,
                     "Server address: unix:PATH or HOST:PORT (TESSERA_SERVER; default: the socket "
                     "in $XDG_RUNTIME_DIR/tessera, else 127.0.0.1:7420)");
  command
      .add_option("--certs", connection.certs,
                  "Directory with ca.crt, tls.crt and tls.key, for a server on another machine "
                  "(TESSERA_CERTS)")
      ->type_name("DIR");
  command
      .add_option("--token", connection.token_file,
                  "File with the server's token (or the token itself in TESSERA_TOKEN)")
      ->type_name("FILE");
}

void add_job_argument(CLI::App& command, std::string& job) {
  command.add_option("job", job, "Job ID, unique prefix, name, or `last`")->required();
}

std::string farm_folder() {
  const char* folder = std::getenv("XDG_RUNTIME_DIR");
  return folder != nullptr && *folder == '/' ? absl::StrCat(folder, "/tessera")
                                             : absl::StrCat("/tmp/tessera-", ::geteuid());
}

bool is_private_folder(const std::string& path) {
  struct stat info {};
  return ::lstat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode) && info.st_uid == ::geteuid() &&
         (info.st_mode & (S_IRWXG | S_IRWXO)) == 0;
}

std::string default_server() {
  const std::string folder = farm_folder(), path = folder + "/server.sock";
  struct stat info {};
  const bool is_socket = ::stat(path.c_str(), &info) == 0 && S_ISSOCK(info.st_mode);
  return is_socket && is_private_folder(folder) ? "unix:" + path : "127.0.0.1:7420";
}

int fail(const absl::Status& status) {
  std::fprintf(stderr, "tessera: %s\n", std::string(status.message()).c_str());
  return exit_code(status.code());
}

void exit_at_once([[maybe_unused]] int code) {
#ifndef TESSERA_ALWAYS_CLEANS_UP
  if (std::fflush(nullptr) == 0) std::_Exit(code);
#endif
}

}  // namespace tessera::client
