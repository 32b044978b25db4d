#include "server/identity/join_tokens.h"

#include <openssl/rand.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "server/identity/private_file.h"

namespace tessera::server {
namespace {

constexpr std::size_t kIdDigits = 8;

/// Checks an ID, which comes from the network and becomes a file name: eight hexadecimal digits.
bool is_token_id(const std::string& id) {
  return id.size() == kIdDigits && id.find_first_not_of("0123456789abcdef") == std::string::npos;
}

absl::Status no_such_token() {
  return absl::UnauthenticatedError(
      "this join token is unknown or revoked; create one with `tessera-server tokens create`");
}

}  // namespace

absl::StatusOr<std::string> JoinTokens::create(std::int64_t expires_s,
                                               std::int64_t max_joins) const {
  const std::filesystem::path store = std::filesystem::path(folder_).parent_path();
  std::error_code error;
  if (!std::filesystem::is_directory(store, error)) {
    return absl::NotFoundError(absl::StrCat(store.string(),
                                            ": no store; name the directory that "
                                            "`tessera-server --store` uses"));
  }
  contract::Digest secret, name;
  if (RAND_bytes(secret.bytes.data(), static_cast<int>(secret.bytes.size())) != 1 ||
      RAND_bytes(name.bytes.data(), static_cast<int>(name.bytes.size())) != 1) {
    return absl::InternalError("no random bytes for a token");
  }
  if (absl::Status status = make_private_folder(folder_); !status.ok()) return status;
  const std::string id = name.hex().substr(0, kIdDigits);
  const std::string text = absl::StrCat("sha256 ", contract::sha256(secret.hex()).hex(),
                                        "\nexpires ", expires_s, "\njoins ", max_joins, "\n");
  absl::Status status = write_file(absl::StrCat(folder_, "/", id), text, kPrivate);
  if (!status.ok()) return status;
  return absl::StrCat(id, ".", secret.hex());
}

absl::StatusOr<JoinToken> JoinTokens::read(const std::string& id) const {
  const auto text = read_file(absl::StrCat(folder_, "/", id));
  if (!text.ok()) return text.status();
  JoinToken token;
  token.id = id;
  int fields = 0;
  const std::vector<std::string> lines = absl::StrSplit(*text, '\n');
  for (const std::string& line : lines) {
    const std::vector<std::string> words = absl::StrSplit(line, ' ');
    if (words.size() != 2) continue;
    if (words[0] == "sha256") {
      const auto digest = contract::Digest::from_hex(words[1]);
      if (digest) token.secret_sha256 = *digest;
      fields += digest.has_value();
    } else if (words[0] == "expires") {
      fields += absl::SimpleAtoi(words[1], &token.expires_s);
    } else if (words[0] == "joins") {
      fields += absl::SimpleAtoi(words[1], &token.max_joins);
    }
  }
  if (fields != 3)
    return absl::DataLossError(absl::StrCat(folder_, "/", id, " does not contain a token"));
  return token;
}

absl::StatusOr<std::vector<JoinToken>> JoinTokens::list() const {
  std::vector<JoinToken> tokens;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    const std::string id = entry.path().filename().string();
    if (!is_token_id(id)) continue;
    auto token = read(id);
    if (absl::IsNotFound(token.status())) continue;  // revoked in the meantime
    if (!token.ok()) return token.status();
    tokens.push_back(*std::move(token));
  }
  if (error && error != std::errc::no_such_file_or_directory) {
    return absl::ErrnoToStatus(error.value(), folder_);
  }
  std::sort(tokens.begin(), tokens.end(), [](const auto& a, const auto& b) { return a.id < b.id; });
  return tokens;
}

absl::Status JoinTokens::revoke(const std::string& id) const {
  if (!is_token_id(id) || ::unlink(absl::StrCat(folder_, "/", id).c_str()) != 0) {
    return absl::NotFoundError(absl::StrCat("no join token \"", id, "\""));
  }
  return absl::OkStatus();
}

absl::StatusOr<JoinToken> JoinTokens::find(const std::string& text, std::int64_t now_s) const {
  const std::size_t dot = text.find('.');
  const std::string id = text.substr(0, dot);
  if (dot == std::string::npos || !is_token_id(id)) return no_such_token();
  auto token = read(id);
  if (absl::IsNotFound(token.status())) return no_such_token();
  if (!token.ok()) return token.status();
  if (!contract::equal_in_constant_time(contract::sha256(std::string_view(text).substr(dot + 1)),
                                        token->secret_sha256)) {
    return no_such_token();
  }
  if (now_s >= token->expires_s) {
    return absl::UnauthenticatedError(absl::StrCat("the join token ", id, " has expired"));
  }
  return token;
}

}  // namespace tessera::server
