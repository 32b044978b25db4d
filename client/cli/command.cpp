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
                     "Farm to talk to: unix:PATH or HOST:PORT (TESSERA_SERVER; default: the "
                     "socket in $XDG_RUNTIME_DIR/tessera, else 127.0.0.1:7420)");
  command
      .add_option("--certs", connection.certs,
                  "Folder with ca.crt, tls.crt and tls.key, for a farm on other machines "
                  "(TESSERA_CERTS)")
      ->type_name("DIR");
  command
      .add_option("--token", connection.token_file,
                  "File with the farm's token (or put the token itself into TESSERA_TOKEN)")
      ->type_name("FILE");
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

int exit_code(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kOk:
      return kExitDone;
    case absl::StatusCode::kCancelled:
      return kExitInterrupted;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kNotFound:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kUnimplemented:
      return kExitBadInput;
    default:
      return kExitUnreachable;
  }
}

int fail(const absl::Status& status) {
  std::fprintf(stderr, "tessera: %s\n", std::string(status.message()).c_str());
  return exit_code(status);
}

}  // namespace tessera::client
