#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"

namespace tessera::server {

/// What lets a worker join, apart from its certificate. Its text, ID.SECRET, is shown once; kept is
/// the SHA-256 of the secret, which has 256 random bits, so that a plain hash is enough.
struct JoinToken {
  std::string id;
  contract::Digest secret_sha256;
  std::int64_t expires_s = 0;  // since 1970
  std::int64_t max_joins = 0;  // 0: no limit
};

/// The join tokens of a store: STORE/tokens/ID, a file each, mode 0600. Made and removed by
/// `tessera-server tokens` while the server runs, which only reads them; who has joined with which
/// is in the store's journal.
class JoinTokens {
 public:
  explicit JoinTokens(const std::string& store_folder) : folder_(store_folder + "/tokens") {}

  /// Makes a token; its text. Errors: NotFound, there is no store; others of errno.
  absl::StatusOr<std::string> create(std::int64_t expires_s, std::int64_t max_joins) const;
  /// All that are not revoked, by id; expired ones too.
  absl::StatusOr<std::vector<JoinToken>> list() const;
  /// Errors: NotFound.
  absl::Status revoke(const std::string& id) const;
  /// The token that `text` is, in force at `now_s`. Constant time in the secret.
  ///
  /// Errors: Unauthenticated, there is no such token, or none any more.
  absl::StatusOr<JoinToken> find(const std::string& text, std::int64_t now_s) const;

 private:
  absl::StatusOr<JoinToken> read(const std::string& id) const;

  const std::string folder_;
};

}  // namespace tessera::server
