#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace tessera::client {

/// Posts JSON documents to one HTTP address over a persistent connection.
class HttpPoster {
 public:
  struct Options {
    std::string url;     // http:// or https://; redirects are not followed
    std::string secret;  // key of the signature; empty: unsigned
    absl::Duration request_timeout = absl::Seconds(30);  // for one request
  };

  /// Errors: InvalidArgument, the address is not an HTTP URL.
  static absl::StatusOr<std::unique_ptr<HttpPoster>> create(const Options& options);
  virtual ~HttpPoster() = default;

  /// Posts `body`. With a secret, adds the header `Tessera-Signature: sha256=` and the hexadecimal
  /// HMAC-SHA-256 of the body. Returns OK for responses 200 to 299.
  ///
  /// Errors, which never contain the path of the address: Unavailable, a retry may succeed (no
  /// response; 408, 425, 429 and 500 to 599); FailedPrecondition, any other response; Cancelled
  /// after cancel(). One thread at a time.
  virtual absl::Status post(const std::string& body) = 0;

  /// Retry-After of the last response; zero if it had none.
  virtual absl::Duration retry_after() const = 0;

  /// Makes the running post and all later ones end within a second. Thread-safe.
  virtual void cancel() = 0;
};

}  // namespace tessera::client
