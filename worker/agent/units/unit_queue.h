#pragma once

#include <chrono>
#include <compare>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "contract/digest.h"
#include "contract/traversal_counts.h"
#include "contract/unit.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::agent {

using Clock = std::chrono::steady_clock;
using Time = Clock::time_point;

/// A unit with the job it belongs to.
struct UnitKey {
  std::string job_id;
  contract::Unit unit;
  auto operator<=>(const UnitKey&) const = default;
};

UnitKey key_of(const v1::UnitId& id);
v1::UnitId id_of(const UnitKey& key);
/// Returns "JOB FRAME TILE PASS", for logs.
std::string to_string(const UnitKey& key);

/// Maximum number of units leased to a worker.
struct CreditWindow {
  std::int32_t prefetch_limit = 0;   // leased, with blocks not yet handed to the delivery stream
  std::int32_t in_flight_limit = 0;  // leased and not acknowledged
};

/// The units of a worker from lease to acknowledgement: waiting → started → unacknowledged → gone.
///
/// A pure state machine: no thread, clock or socket. It implements the worker's side of
/// docs/explanation/fault-tolerance.md: a block is kept until its acknowledgement and offered again
/// on every new stream; started units are never returned; the units leased and not acknowledged
/// never exceed the window. The caller serialises the calls.
class UnitQueue {
 public:
  /// A finished unit to deliver.
  struct Block {
    UnitKey key;
    std::shared_ptr<const v1::Lease> lease;
    std::shared_ptr<const std::string> bytes;  // shared: may be acknowledged while being sent
    contract::Digest sha256;
    double cpu_seconds = 0;
    contract::TraversalCounts cost;
  };

  // Leases.
  /// Adds the units of a lease. A unit that is present already keeps its state; an unacknowledged
  /// one is offered again under the new lease.
  void add_lease(const v1::Lease& lease);
  /// Waiting units, in the order of their leases.
  const std::deque<UnitKey>& waiting() const { return waiting_; }
  /// Returns the lease of a unit; null if the unit is not present.
  const v1::Lease* lease_of(const UnitKey& key) const;
  /// Removes those of `units` that are waiting, and returns them.
  std::vector<UnitKey> revoke(const std::vector<UnitKey>& units);
  /// Removes all waiting units, and returns them.
  std::vector<UnitKey> return_waiting();

  // Rendering.
  /// Marks a waiting unit started: it was handed to the renderer.
  void start(const UnitKey& key);
  /// Makes a started unit wait again, first in line.
  void requeue(const UnitKey& key);
  /// Stores the block of a started unit. Returns false, and does nothing, if the unit is not
  /// started: its job may have ended.
  bool finish(const UnitKey& key, std::string block, const contract::Digest& sha256,
              double cpu_seconds, const contract::TraversalCounts& cost = {});
  /// Removes a waiting or started unit and returns the message for the server; nullopt if there is
  /// no such unit. `code` INVALID_ARGUMENT, NOT_FOUND or UNIMPLEMENTED: the scene is at fault.
  std::optional<v1::UnitFailure> fail(const UnitKey& key, const std::string& message,
                                      const std::string& log_tail, absl::StatusCode code);
  /// Started units, sorted by key.
  std::vector<UnitKey> started() const;

  // Delivery.
  /// Returns the next unacknowledged block that has not been offered on this stream, and marks it
  /// offered at `now`.
  std::optional<Block> next_block(Time now);
  /// Returns when a block was offered on this stream; nullopt if it was not.
  std::optional<Time> offered(const UnitKey& key) const;
  /// Returns when the oldest offered and unacknowledged block was offered; nullopt if there is
  /// none.
  std::optional<Time> oldest_offer() const;
  /// Marks all unacknowledged blocks as not offered, for a new delivery stream.
  void reset_offers();
  /// Removes an acknowledged unit. Returns false if the unit is not unacknowledged.
  bool acknowledge(const UnitKey& key);

  // The server.
  /// Adds the units that the server adopts and the credits to `hello`. Waiting units are removed:
  /// the server leases them again.
  void fill_hello(v1::WorkerHello& hello, const CreditWindow& window);
  /// Sets the server's store. If it differs from the previous one, removes all units.
  void set_store(const std::string& store_id);
  void drop_job(const std::string& job_id);
  /// Returns the credits to grant without exceeding `window`, and counts them as granted. Blocks
  /// already handed to the stream free prefetch slots; queued ones do not, which throttles
  /// rendering to the send rate.
  std::int32_t credits_to_grant(const CreditWindow& window);
  /// Number of units leased and not acknowledged.
  std::int32_t size() const { return static_cast<std::int32_t>(entries_.size()); }
  bool empty() const { return entries_.empty(); }

 private:
  enum class Phase : std::uint8_t { waiting, started, unacknowledged };
  struct Entry {
    std::shared_ptr<const v1::Lease> lease;  // shared by all units of the lease
    Phase phase = Phase::waiting;
    std::optional<Time> offered;  // on this delivery stream
    std::shared_ptr<const std::string> block;
    contract::Digest sha256;
    double cpu_seconds = 0;
    contract::TraversalCounts cost;
  };

  std::int32_t room(const CreditWindow& window) const;
  Entry* find(const UnitKey& key, Phase phase);
  void erase(const UnitKey& key);

  std::map<UnitKey, Entry> entries_;
  std::deque<UnitKey> waiting_;   // keys of waiting entries
  std::set<UnitKey> started_;     // keys of started entries
  std::deque<UnitKey> to_offer_;  // keys of blocks not offered yet; may include removed ones
  std::int32_t credits_ = 0;      // granted and not used by a lease yet
  std::string store_id_;
};

/// Returns the window of a worker: prefetch_limit is 2 × threads plus the units rendered during
/// `ack_latency_seconds`; in_flight_limit is the number of blocks that fit into `buffer_bytes`, at
/// least 1.
CreditWindow credit_window(int thread_count, double ack_latency_seconds, double unit_seconds,
                           std::int64_t block_bytes, std::int64_t buffer_bytes);

}  // namespace tessera::agent
