#include "server/service/access/client_limits.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

constexpr double kBurstSeconds = 10, kSecondsPerHour = 3600;

}  // namespace

bool ClientLimits::Bucket::take(double amount, double capacity, double leak_per_s, Time now) {
  const std::chrono::duration<double> elapsed = now - updated;
  level = std::max(0.0, level - elapsed.count() * leak_per_s);
  updated = now;
  if (level + amount > capacity) return false;
  level += amount;
  return true;
}

absl::StatusOr<std::shared_ptr<const void>> ClientLimits::reserve_stream(
    const std::string& client) {
  const std::lock_guard lock(uses_->mutex);
  int& count = uses_->by_client[client].streams;
  if (count >= kStreamsPerClient) {
    return absl::ResourceExhaustedError(
        absl::StrCat("client ", client, " has ", count, " open streams; close one first"));
  }
  ++count;
  return std::shared_ptr<const void>(nullptr, [uses = uses_, client](const void*) {
    const std::lock_guard end_lock(uses->mutex);
    --uses->by_client[client].streams;
  });
}

absl::Status ClientLimits::count_call(const std::string& client, Time now) {
  const double rate = rates_.calls_per_s;
  const std::lock_guard lock(uses_->mutex);
  if (rate == 0 || uses_->by_client[client].calls.take(1, kBurstSeconds * rate, rate, now)) {
    return absl::OkStatus();
  }
  return absl::UnavailableError(
      absl::StrCat("client ", client, " exceeds ", rate, " calls per second; retry later"));
}

absl::Status ClientLimits::count_upload(const std::string& client, std::int64_t bytes, Time now) {
  const double limit = rates_.upload_bytes_per_hour;
  const std::lock_guard lock(uses_->mutex);
  if (limit == 0 || uses_->by_client[client].upload_bytes.take(static_cast<double>(bytes), limit,
                                                               limit / kSecondsPerHour, now)) {
    return absl::OkStatus();
  }
  return absl::ResourceExhaustedError(
      absl::StrCat("client ", client, " may upload ", limit / 1e9,
                   " GB per hour (--client-upload-gb of the server); this file of ", bytes,
                   " bytes exceeds that; retry later"));
}

}  // namespace tessera::server
