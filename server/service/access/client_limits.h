#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

/// What a client may do in a time; 0: any number.
struct ClientRates {
  double calls_per_s = 500;
  double upload_bytes_per_hour = 50e9;
};

/// Keeps clients from taking what others need, each by its name over all its connections: streams
/// open at a time, calls, bytes uploaded. Calls and bytes fill a bucket that leaks at the rate
/// allowed: ten seconds' worth of calls, an hour's of bytes, may come at once. Any thread.
class ClientLimits {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr int kStreamsPerClient = 8;

  explicit ClientLimits(ClientRates rates = {}) : rates_(rates) {}

  /// A place for a stream, kept until the object goes. Errors: ResourceExhausted.
  absl::StatusOr<std::shared_ptr<const void>> open(const std::string& client);
  /// Counts a call. Errors: Unavailable, call again after a pause.
  absl::Status call(const std::string& client, Time now);
  /// Counts what is about to be uploaded. Errors: ResourceExhausted, and what to do.
  absl::Status upload(const std::string& client, std::int64_t bytes, Time now);

 private:
  /// What came and has not leaked yet.
  struct Bucket {
    double level = 0;
    Time updated;
    bool take(double amount, double capacity, double leak_per_s, Time now);
  };
  struct Use {
    int streams = 0;
    Bucket calls, upload_bytes;
  };
  struct Uses {
    std::mutex mutex;
    std::map<std::string, Use> by_client;  // by client: one for each certificate's name
  };
  const ClientRates rates_;
  const std::shared_ptr<Uses> uses_ = std::make_shared<Uses>();  // owners: this and the places
};

}  // namespace tessera::server
