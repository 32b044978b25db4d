#include "client/api/server_token.h"

#include <cstdlib>
#include <fstream>

#include "absl/strings/str_cat.h"

namespace tessera::client {

absl::StatusOr<std::string> read_token(const std::string& file) {
  if (file.empty()) {
    const char* token = std::getenv("TESSERA_TOKEN");
    return std::string(token == nullptr ? "" : token);
  }
  std::ifstream stream(file);
  std::string token;
  if (!std::getline(stream, token)) {
    return absl::NotFoundError(absl::StrCat(file, ": cannot read the token"));
  }
  return token;
}

}  // namespace tessera::client
