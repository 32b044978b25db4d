#include "server/service/quotas/client_limits.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <optional>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

// Calls that a client may make at once: as many as its rate allows in kBurstSeconds. A longer burst
// would delay other clients' calls, while a shorter one would cost a client that is refused part of
// its rate: the pause before the answer and the client's own, at most 0.8 s together, must not
// exceed it. Clients with a low rate may make kMinBurst calls, more than a command of `tessera`
// makes.
constexpr double kBurstSeconds = 1, kMinBurst = 10;
constexpr double kSecondsPerHour = 3600, kGiga = 1e9;
constexpr char kPausePayload[] = "tessera/pause";
constexpr std::chrono::milliseconds kPause{500};

double burst_of(double rate) {
  return std::max(kMinBurst, kBurstSeconds * rate);
}

/// Marks a refusal as one to be answered after a pause, and repeated by the caller.
absl::Status with_pause(absl::Status refusal) {
  refusal.SetPayload(kPausePayload, absl::Cord());
  return refusal;
}

}  // namespace

bool can_be_retried(const absl::Status& refusal) {
  return refusal.GetPayload(kPausePayload).has_value();
}

std::chrono::milliseconds pause_before_answer(const absl::Status& refusal) {
  if (!can_be_retried(refusal)) return std::chrono::milliseconds(0);
  // Successive multiples of the golden ratio modulo 1 are spread evenly.
  static std::atomic<std::uint32_t> count = 0;
  const double spread = (++count * 2654435769U) * 0x1p-32;
  return std::chrono::duration_cast<std::chrono::milliseconds>(kPause * (0.5 + spread));
}

double ClientLimits::Bucket::level_at(double leak_per_s, Time now) const {
  const std::chrono::duration<double> elapsed = now - updated;
  return std::max(0.0, level - elapsed.count() * leak_per_s);
}

bool ClientLimits::Bucket::take(double amount, double capacity, double leak_per_s, Time now) {
  level = level_at(leak_per_s, now);
  updated = now;
  if (level + amount > capacity) return false;
  level += amount;
  return true;
}

absl::Status ClientLimits::refuse(const std::string& client, double ClientQuota::*member,
                                  double used) const {
  const QuotaKind& kind = quota_kind(member);
  if (refused_) refused_(kind);
  return over_quota(client, kind, used, quotas_.of(client).*member);
}

absl::StatusOr<std::shared_ptr<const void>> ClientLimits::reserve_stream(const std::string& client,
                                                                         bool is_subscription) {
  const ClientQuota& quota = quotas_.of(client);
  const MutexLock lock(uses_->mutex);
  Use& use = uses_->by_client[client];
  if (quota.streams > 0 && use.streams + 1 > quota.streams) {
    return refuse(client, &ClientQuota::streams, use.streams + 1);
  }
  if (is_subscription && quota.event_subscriptions > 0 &&
      use.subscriptions + 1 > quota.event_subscriptions) {
    return refuse(client, &ClientQuota::event_subscriptions, use.subscriptions + 1);
  }
  ++use.streams;
  if (is_subscription) ++use.subscriptions;
  return std::shared_ptr<const void>(nullptr, [uses = uses_, client, is_subscription](const void*) {
    const MutexLock end_lock(uses->mutex);
    Use& ended = uses->by_client[client];
    --ended.streams;
    if (is_subscription) --ended.subscriptions;
  });
}

absl::StatusOr<std::shared_ptr<const void>> ClientLimits::reserve_call(const std::string& client) {
  const double limit = quotas_.of(client).concurrent_calls;
  const MutexLock lock(uses_->mutex);
  Use& use = uses_->by_client[client];
  if (limit > 0 && use.calls_in_progress + 1 > limit) {
    return with_pause(refuse(client, &ClientQuota::concurrent_calls, use.calls_in_progress + 1));
  }
  ++use.calls_in_progress;
  return std::shared_ptr<const void>(nullptr, [uses = uses_, client](const void*) {
    const MutexLock end_lock(uses->mutex);
    --uses->by_client[client].calls_in_progress;
  });
}

absl::Status ClientLimits::count_connection(const std::string& client, const std::string& peer,
                                            Time now) {
  const double limit = quotas_.of(client).connections;
  const auto count = static_cast<double>(connections_.use(client, peer, limit, now));
  if (limit == 0 || count <= limit) return absl::OkStatus();
  return refuse(client, &ClientQuota::connections, count);
}

void ClientLimits::note_connection(const std::string& caller, const std::string& peer, Time now) {
  connections_.use(caller, peer, 0, now);
}

absl::Status ClientLimits::count_call(const std::string& client, Time now) {
  const double rate = quotas_.of(client).calls, burst = burst_of(rate);
  const MutexLock lock(uses_->mutex);
  Use& use = uses_->by_client[client];
  if (rate == 0 || use.calls.take(1, burst, rate, now)) return absl::OkStatus();
  return with_pause(refuse(client, &ClientQuota::calls, (use.calls.level + 1) * rate / burst));
}

absl::Status ClientLimits::count_upload(const std::string& client, std::int64_t bytes, Time now) {
  const double limit = quotas_.of(client).upload_gb, gb = static_cast<double>(bytes) / kGiga;
  const MutexLock lock(uses_->mutex);
  Use& use = uses_->by_client[client];
  if (limit == 0 || use.uploads.take(gb, limit, limit / kSecondsPerHour, now)) {
    return absl::OkStatus();
  }
  return refuse(client, &ClientQuota::upload_gb, use.uploads.level + gb);
}

std::set<std::string> ClientLimits::clients() const {
  std::set<std::string> names;
  for (const auto& [client, quota] : quotas_.by_client) names.insert(client);
  const MutexLock lock(uses_->mutex);
  for (const auto& [client, use] : uses_->by_client) names.insert(client);
  return names;
}

double ClientLimits::used(const std::string& client, const QuotaKind& kind, Time now) const {
  if (kind.member == &ClientQuota::connections) {
    return static_cast<double>(connections_.count(client));
  }
  const ClientQuota& quota = quotas_.of(client);
  const MutexLock lock(uses_->mutex);
  const auto found = uses_->by_client.find(client);
  if (found == uses_->by_client.end()) return 0;
  const Use& use = found->second;
  if (kind.member == &ClientQuota::streams) return use.streams;
  if (kind.member == &ClientQuota::event_subscriptions) return use.subscriptions;
  if (kind.member == &ClientQuota::concurrent_calls) return use.calls_in_progress;
  if (kind.member == &ClientQuota::calls) {
    return use.calls.level_at(quota.calls, now) * quota.calls / burst_of(quota.calls);
  }
  if (kind.member == &ClientQuota::upload_gb) {
    return use.uploads.level_at(quota.upload_gb / kSecondsPerHour, now);
  }
  return 0;
}

}  // namespace tessera::server
