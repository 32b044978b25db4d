#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace tessera::client {

/// Posts JSON documents to one HTTP address, over one connection while it lasts.
class HttpPoster {
 public:
  struct Options {
    std::string url;     // http:// or https://; others and redirects are not followed
    std::string secret;  // signs what is posted; empty: unsigned
    absl::Duration connect_timeout = absl::Seconds(30);  // with one answer
  };

  /// Errors: InvalidArgument, not such an address.
  static absl::StatusOr<std::unique_ptr<HttpPoster>> create(const Options& options);
  virtual ~HttpPoster() = default;

  /// Posts `body`, with `Tessera-Signature: sha256=` and the HMAC-SHA-256 of the body under the
  /// secret in hexadecimal if there is one. OK for an answer of 200 to 299.
  ///
  /// Errors, which never hold the address's path: Unavailable, trying again may help (nobody
  /// answers; 408, 425, 429 and 500 to 599); FailedPrecondition, it will not (any other answer);
  /// Cancelled after cancel(). One thread at a time.
  virtual absl::Status post(const std::string& body) = 0;

  /// How long the last answer asked to be left alone (Retry-After); zero: not at all.
  virtual absl::Duration retry_after() const = 0;

  /// Ends the running post and all later ones, soon. From any thread.
  virtual void cancel() = 0;
};

}  // namespace tessera::client
