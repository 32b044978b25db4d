#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "contract/unit.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// Outcome of a delivered result; numbers as in v1.Delivery.Outcome.
enum class DeliveryOutcome : std::int32_t { committed = 1, audit, duplicate };

/// A result that a worker delivered.
struct Delivery {
  std::int64_t sequence = 0;  // set by the log
  std::int64_t job = 0;       // JobKey
  contract::Unit unit;
  std::string_view worker_id;
  DeliveryOutcome outcome = DeliveryOutcome::committed;
  std::int32_t retry_count = 0;  // failures and losses of the unit before its commit
  std::int64_t end_us = 0;       // wall clock: durable, or acknowledged
  double cpu_seconds = 0;
  std::optional<double> lease_seconds = {};             // from lease to end, if known
  std::shared_ptr<const std::string> worker_text = {};  // what worker_id points to; set by the log
};

/// Recent deliveries, for timelines. In memory and bounded: the newest kMaxDeliveries of all jobs,
/// about 100 bytes each, and the IDs of their workers. Thread-safe.
class DeliveryLog {
 public:
  static constexpr std::size_t kMaxDeliveries = 100'000;

  void add(Delivery delivery);
  /// Returns the number of workers with kept deliveries.
  std::size_t worker_count() const;
  /// Returns the oldest `limit` deliveries of a job after this sequence (0: from the first), in
  /// order.
  std::vector<Delivery> read(std::int64_t job, std::int64_t after, std::size_t limit) const;

 private:
  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  std::int64_t last_sequence_ ABSL_GUARDED_BY(mutex_) = 0;
  std::deque<Delivery> deliveries_ ABSL_GUARDED_BY(mutex_);  // consecutive sequences
  /// A worker with kept deliveries. Owners: the log and its deliveries.
  struct Known {
    std::shared_ptr<const std::string> id;
    std::int64_t count = 0;
  };
  std::map<std::string, Known, std::less<>> workers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
