#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

/// Rate limits per client; 0: unlimited.
struct ClientRates {
  double calls_per_s = 500;
  double upload_bytes_per_hour = 50e9;
};

/// Limits open streams, calls and uploaded bytes per client name over all its connections. Calls
/// and bytes are leaky buckets: a burst may have ten seconds of calls or an hour of bytes.
/// Thread-safe.
class ClientLimits {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr int kStreamsPerClient = 8;

  explicit ClientLimits(ClientRates rates = {}) : rates_(rates) {}

  /// Reserves a stream until the result is destroyed. Errors: ResourceExhausted.
  absl::StatusOr<std::shared_ptr<const void>> reserve_stream(const std::string& client);
  /// Counts a call. Errors: Unavailable, retry after a pause.
  absl::Status count_call(const std::string& client, Time now);
  /// Counts bytes about to be uploaded. Errors: ResourceExhausted, limit exceeded.
  absl::Status count_upload(const std::string& client, std::int64_t bytes, Time now);

 private:
  /// A leaky bucket. `level`: the amount that has not leaked yet.
  struct Bucket {
    double level = 0;
    Time updated;
    bool take(double amount, double capacity, double leak_per_s, Time now);
  };
  /// Use of one client.
  struct Use {
    int streams = 0;
    Bucket calls, upload_bytes;
  };
  struct Uses {
    std::mutex mutex;
    std::map<std::string, Use> by_client;  // by the certificate's name
  };
  const ClientRates rates_;
  const std::shared_ptr<Uses> uses_ =
      std::make_shared<Uses>();  // owners: this and the reservations
};

}  // namespace tessera::server
