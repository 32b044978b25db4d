#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "server/service/quotas/client_connections.h"
#include "server/state/client_quota.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Returns how long to wait before a refusal is answered. A client whose call can be retried is
/// slowed down by that: its connection has a limited number of calls in progress. Pauses differ, so
/// that threads that are refused at the same time do not call again at the same time.
std::chrono::milliseconds pause_before_answer(const absl::Status& refusal);

/// Returns whether the refused call can be made again after a while: the client has called too
/// often or has too many calls in progress.
bool can_be_retried(const absl::Status& refusal);

/// Limits open streams, event subscriptions, connections, calls in progress, calls per second and
/// uploaded bytes per client name over all its connections. Calls per second and bytes are leaky
/// buckets: a burst may have a second of calls, at least ten, or an hour of bytes. Errors are
/// ResourceExhausted, see over_quota(). Thread-safe.
class ClientLimits {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// `refused` is called with the kind of each refusal; may be empty.
  explicit ClientLimits(ClientQuotas quotas = {},
                        std::function<void(const QuotaKind&)> refused = {})
      : quotas_(std::move(quotas)), refused_(std::move(refused)) {}

  /// Reserves a stream until the result is destroyed.
  absl::StatusOr<std::shared_ptr<const void>> reserve_stream(const std::string& client,
                                                             bool is_subscription);
  /// Reserves a place among the client's calls in progress until the result is destroyed. The
  /// refusal has a pause.
  absl::StatusOr<std::shared_ptr<const void>> reserve_call(const std::string& client);
  /// Counts the connection of a call. `peer`: as of grpc::ServerContext::peer().
  absl::Status count_connection(const std::string& client, const std::string& peer, Time now);
  /// Notes that a caller without limits uses a connection.
  void note_connection(const std::string& caller, const std::string& peer, Time now);
  /// Counts a call. The refusal has a pause.
  absl::Status count_call(const std::string& client, Time now);
  /// Counts bytes about to be uploaded.
  absl::Status count_upload(const std::string& client, std::int64_t bytes, Time now);

  /// Returns the clients that have called and those with quotas of their own.
  std::set<std::string> clients() const;
  /// Returns a client's use in the quota's unit; of calls, those per second over about the last
  /// second. 0 for kinds that are not limited here.
  double used(const std::string& client, const QuotaKind& kind, Time now) const;
  const ClientQuotas& quotas() const { return quotas_; }
  ClientConnections& connections() { return connections_; }

 private:
  /// A leaky bucket. `level`: the amount that has not leaked yet.
  struct Bucket {
    double level = 0;
    Time updated;
    bool take(double amount, double capacity, double leak_per_s, Time now);
    double level_at(double leak_per_s, Time now) const;
  };
  /// Use of one client.
  struct Use {
    double streams = 0, subscriptions = 0, calls_in_progress = 0;
    Bucket calls, uploads;  // calls, GB
  };
  struct Uses {
    Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
    std::map<std::string, Use> by_client ABSL_GUARDED_BY(mutex);  // by the certificate's name
  };
  absl::Status refuse(const std::string& client, double ClientQuota::*member, double used) const;

  const ClientQuotas quotas_;
  const std::function<void(const QuotaKind&)> refused_;
  ClientConnections connections_;
  const std::shared_ptr<Uses> uses_ =
      std::make_shared<Uses>();  // owners: this and the reservations
};

}  // namespace tessera::server
