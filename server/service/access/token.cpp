#include "server/service/access/token.h"

#include <fcntl.h>
#include <openssl/rand.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"

namespace tessera::server {
namespace {

absl::StatusOr<std::string> read_token(int file, const std::string& path) {
  struct stat info {};
  if (::fstat(file, &info) != 0 || (info.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat(path, " is readable by other users; set its mode to 0600"));
  }
  std::array<char, 128> buffer{};
  const ssize_t got = ::read(file, buffer.data(), buffer.size());
  std::string token(buffer.data(), static_cast<std::size_t>(std::max<ssize_t>(got, 0)));
  while (!token.empty() && token.back() == '\n') token.pop_back();
  if (!contract::Digest::from_hex(token)) {
    return absl::DataLossError(
        absl::StrCat(path, " does not contain a token; delete it to get a new one"));
  }
  return token;
}

}  // namespace

absl::StatusOr<std::string> load_or_create_token(const std::string& path) {
  const int present = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (present >= 0) {
    auto token = read_token(present, path);
    ::close(present);
    return token;
  }
  contract::Digest secret;
  if (RAND_bytes(secret.bytes.data(), static_cast<int>(secret.bytes.size())) != 1) {
    return absl::InternalError("no random bytes available for a token");
  }
  // Written under another name first, so that clients never read half a token.
  const std::string part = absl::StrCat(path, ".part");
  ::unlink(part.c_str());
  const int made = ::open(part.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  const std::string line = secret.hex() + "\n";
  const bool is_written =
      made >= 0 && ::write(made, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  if (made >= 0) ::close(made);
  if (!is_written || ::rename(part.c_str(), path.c_str()) != 0) {
    return absl::PermissionDeniedError(absl::StrCat(path, ": ", std::strerror(errno)));
  }
  return secret.hex();
}

}  // namespace tessera::server
