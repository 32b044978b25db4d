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

#include "contract/digest.h"
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
/// "JOB FRAME TILE PASS", for logs.
std::string to_string(const UnitKey& key);

/// How many units a worker wants.
struct CreditWindow {
  std::int32_t ahead = 0;  // leased, and their blocks not yet under way to the server
  std::int32_t total = 0;  // leased and not acknowledged
};

/// The units a worker has, from lease to verdict: waiting → started → held → forgotten.
///
/// A pure state machine: no thread, clock or socket. It keeps farm.md's promises on the worker's
/// side: a block is kept until its one verdict and offered again on every new stream; what has been
/// started is never handed back; the units leased and not acknowledged never exceed the window.
class UnitQueue {
 public:
  /// A finished unit to deliver.
  struct Block {
    UnitKey key;
    std::shared_ptr<const v1::Lease> lease;
    std::shared_ptr<const std::string> bytes;  // shared: a verdict may come while it is being sent
    contract::Digest sha256;
    double cpu_seconds = 0;
  };

  // Leases.
  /// Takes a lease: its units wait, but for those that are here already. A held one is offered
  /// again under the new lease.
  void add_lease(const v1::Lease& lease);
  /// Units that wait, in the order they were leased.
  const std::deque<UnitKey>& waiting() const { return waiting_; }
  /// The lease of a unit that is here; null otherwise.
  const v1::Lease* lease_of(const UnitKey& key) const;
  /// Forgets those of `units` that wait, and returns them.
  std::vector<UnitKey> revoke(const std::vector<UnitKey>& units);
  /// Forgets every unit that waits, and returns them.
  std::vector<UnitKey> hand_back_waiting();

  // Rendering.
  /// A waiting unit was handed to the renderer.
  void start(const UnitKey& key);
  /// A started unit must be rendered again: it waits once more, first in line.
  void requeue(const UnitKey& key);
  /// Its block. Ignored (false) unless the unit is started: its job may have ended meanwhile.
  bool finish(const UnitKey& key, std::string block, const contract::Digest& sha256,
              double cpu_seconds);
  /// Forgets a unit that waits or is started and returns what to tell the server; nullopt if it is
  /// not here.
  std::optional<v1::UnitFailure> fail(const UnitKey& key, const std::string& message,
                                      const std::string& log_tail, bool bad_scene);
  /// Started units, in order.
  std::vector<UnitKey> started() const;

  // Delivery.
  /// The next held block that has not been offered on this stream; it counts as offered now.
  std::optional<Block> next_block(Time now);
  /// When a held block was offered on this stream; nullopt: it was not, or is not held.
  std::optional<Time> offered(const UnitKey& key) const;
  /// When the block was offered that waits longest for its verdict; nullopt: none does.
  std::optional<Time> oldest_offer() const;
  /// A new delivery stream: every held block is offered again.
  void offer_all_again();
  /// The verdict on a delivered block: forgets it. False if it was not held.
  bool acknowledge(const UnitKey& key);

  // The server.
  /// Fills in what the server adopts, and the credits; units that wait are forgotten, as the server
  /// leases them anew.
  void describe(v1::WorkerHello& hello, const CreditWindow& window);
  /// The store is another one: everything from before is worthless.
  void welcome(const std::string& store_id);
  void drop_job(const std::string& job_id);
  /// Credits to grant now so that no more units are leased, or may be, than the window says. Blocks
  /// that the line has taken make room ahead: however many are on their way, the next units are
  /// here in time. Those it has no room for yet do not, so that units are rendered no faster than
  /// sent.
  std::int32_t credits_to_grant(const CreditWindow& window);
  /// Units leased and not acknowledged.
  std::int32_t size() const { return static_cast<std::int32_t>(entries_.size()); }
  bool empty() const { return entries_.empty(); }

 private:
  enum class Phase : std::uint8_t { waiting, started, held };
  struct Entry {
    std::shared_ptr<const v1::Lease> lease;  // owned by all units of its run together
    Phase phase = Phase::waiting;
    std::optional<Time> offered;  // on this delivery stream
    std::shared_ptr<const std::string> block;
    contract::Digest sha256;
    double cpu_seconds = 0;
  };

  std::int32_t room(const CreditWindow& window) const;
  Entry* find(const UnitKey& key, Phase phase);
  void erase(const UnitKey& key);

  std::map<UnitKey, Entry> entries_;
  std::deque<UnitKey> waiting_;   // keys of entries that wait
  std::deque<UnitKey> to_offer_;  // keys of held entries, not offered; may name forgotten ones
  std::int32_t credits_ = 0;      // granted, and no lease came for them yet
  std::string store_id_;
};

/// How many units a worker should have: 2 × threads, and as many as are rendered during the round
/// trip from a credit to its lease; in all at most what `buffer_bytes` holds, at least one
/// (farm.md, section 2).
CreditWindow credit_window(int thread_count, double round_trip_seconds, double unit_seconds,
                           std::int64_t block_bytes, std::int64_t buffer_bytes);

}  // namespace tessera::agent
