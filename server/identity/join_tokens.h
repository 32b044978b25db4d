#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/digest.h"

namespace tessera::server {

/// A token with which workers join, in addition to their certificate. Its text, ID.SECRET, is shown
/// once; only the SHA-256 of the secret is stored. The secret has 256 random bits, so a plain hash
/// suffices.
struct JoinToken {
  std::string id;
  contract::Digest secret_sha256;
  std::int64_t expires_s = 0;  // since 1970
  std::int64_t max_joins = 0;  // 0: unlimited
};

/// The join tokens of a store: STORE/tokens/ID, one file each, mode 0600. `tessera-server tokens`
/// creates and deletes them while the server, which only reads them, runs. The store's journal
/// records who joined with which.
class JoinTokens {
 public:
  explicit JoinTokens(const std::string& store_folder) : folder_(store_folder + "/tokens") {}

  /// Creates a token and returns its text. Errors: NotFound, no store; others of errno.
  absl::StatusOr<std::string> create(std::int64_t expires_s, std::int64_t max_joins) const;
  /// Returns all tokens that are not revoked, by ID, including expired ones.
  absl::StatusOr<std::vector<JoinToken>> list() const;
  /// Errors: NotFound.
  absl::Status revoke(const std::string& id) const;
  /// Returns the token with this text that is valid at `now_s`. Constant time in the secret.
  ///
  /// Errors: Unauthenticated, no such token, or it has expired or is revoked.
  absl::StatusOr<JoinToken> find(const std::string& text, std::int64_t now_s) const;

 private:
  absl::StatusOr<JoinToken> read(const std::string& id) const;

  const std::string folder_;
};

}  // namespace tessera::server
