#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "rpc/backoff.h"
#include "tessera/v1/worker_service.grpc.pb.h"
#include "tests/bench/coordinator/simulated_block.h"

namespace tessera::bench {

/// Durations of one kind. Thread-safe.
class Latencies {
 public:
  void add(std::int64_t microseconds) {
    const std::lock_guard lock(mutex_);
    microseconds_.push_back(microseconds);
  }
  /// Returns a quantile in milliseconds, 0 if there are none.
  double quantile_ms(double share);

 private:
  std::mutex mutex_;
  std::vector<std::int64_t> microseconds_;
};

/// When the first unit of each job was leased, in microseconds of the monotonic clock. Thread-safe.
class FirstLeases {
 public:
  void add(const std::string& job_id, std::int64_t now_us) {
    const std::lock_guard lock(mutex_);
    leased_us_.emplace(job_id, now_us);
  }
  /// Writes a line with ID and time for each job; returns false if that fails.
  bool write(const std::string& path);

 private:
  std::mutex mutex_;
  std::map<std::string, std::int64_t> leased_us_;
};

/// Counters of all simulated workers of a process.
struct Counters {
  std::atomic<std::int64_t> welcomed = 0, committed = 0, duplicate = 0, obsolete = 0, rejected = 0;
  std::atomic<std::int64_t> committed_bytes = 0;
  std::atomic<std::int64_t> first_lease_us = 0, last_commit_us = 0;  // monotonic clock
  std::atomic<std::int64_t> closed = 0;                              // streams the server ended
  std::atomic<std::int64_t> connected = 0;                           // workers, now
  /// From granting credits to the next leases, for workers that still have units. While the queue
  /// is empty this contains the wait for a job.
  Latencies lease;
  FirstLeases first_leases;
  /// From sending a block to its acknowledgement.
  Latencies commit;
};

/// Films by job ID, created when a job is first seen.
class FilmShelf {
 public:
  FilmShelf(const std::shared_ptr<grpc::Channel>& channel, std::string token);
  /// Uses the key of a worker's session instead of the token.
  void set_token(const std::string& token);
  void describe(const v1::JobDescription& job);
  /// Asks the server for a job that was not described. Null if it does not know the job.
  const SimulatedFilm* film(const std::string& job_id);

 private:
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  std::string token_;
  std::mutex mutex_;
  std::map<std::string, std::unique_ptr<SimulatedFilm>> films_;
};

struct SimulatedWorkerOptions {
  std::string id;
  std::string token;
  std::string numerics;  // 32 bytes
  std::int32_t credits = 64;
  bool reconnects = false;  // with the pauses of a real worker
};

/// A worker that renders nothing: it answers each lease immediately with fabricated blocks, over
/// its own connection and streams.
class SimulatedWorker {
 public:
  SimulatedWorker(std::shared_ptr<grpc::Channel> channel, SimulatedWorkerOptions options,
                  FilmShelf& shelf, Counters& counters);
  ~SimulatedWorker();
  void start();
  void send_heartbeat();
  /// Connects again if the streams have ended and the pause is over. Call often, on one thread.
  void reconnect_if_due();

 private:
  class WorkStream;
  class DeliverStream;
  struct PendingUnit {
    v1::Lease lease;
    std::int32_t tile = 0;
  };

  void on_event(const v1::WorkResponse& event);
  void on_stream_ended(bool is_work);
  void on_acknowledgements(const v1::AcknowledgementBatch& batch);
  bool next_delivery(v1::DeliverRequest& message);  // false: nothing to send now

  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::WorkerService::Stub> stub_;
  const SimulatedWorkerOptions options_;
  FilmShelf& shelf_;
  Counters& counters_;

  std::mutex mutex_;
  std::deque<PendingUnit> pending_;
  std::int64_t outstanding_ = 0;                 // leased units without acknowledgement
  std::map<std::string, std::int64_t> sent_us_;  // by unit: when its block was sent
  std::int64_t granted_us_ = 0;  // when credits were granted; 0: leases have come since
  std::string open_block_;       // too long for one message; sent up to open_offset_
  std::size_t open_offset_ = 0;
  contract::Backoff backoff_{std::chrono::milliseconds(50), std::chrono::milliseconds(2000)};
  bool is_welcome_ = false;
  int open_streams_ = 0;
  std::int64_t reconnect_us_ = 0;  // 0: not due
  std::string session_key_;        // empty: none issued
  std::unique_ptr<WorkStream> work_;
  std::unique_ptr<DeliverStream> deliver_;
};

}  // namespace tessera::bench
