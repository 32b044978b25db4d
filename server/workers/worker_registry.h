#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/commit/commit_pipeline.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Connection to a worker. Thread-safe, non-blocking, called without locks; the caller holds a
/// reference.
class WorkerConnection {
 public:
  virtual ~WorkerConnection() = default;
  /// The worker's outbox has messages: fetch them with WorkerRegistry::take_outbox.
  virtual void wake() = 0;
  /// Ends the stream: ABORTED, a newer stream replaced it; UNAVAILABLE, the worker timed out and
  /// must reconnect.
  virtual void close(const absl::Status& reason) = 0;
};

/// One connection of a worker. A session ends when a newer one of the same worker starts; calls
/// with an ended session do nothing.
struct Session {
  WorkerKey worker = 0;
  std::int64_t number = 0;
};

/// A line of a worker's log about a job.
struct LogLine {
  std::string job_id;
  std::string text;
};

/// Connections of workers: handles their reports, their outboxes, and operators' commands for them.
/// Thread-safe; its table is changed only with the farm locked.
class WorkerRegistry final : public EffectHandler {
 public:
  WorkerRegistry(FarmState& farm, Store& store, CommitPipeline& pipeline)
      : farm_(farm), store_(store), pipeline_(pipeline) {}

  struct Joined {
    Session session;
    std::string store_id;
    std::int32_t heartbeat_ms = 1000;
    std::int32_t timeout_ms = 5000;
  };
  /// Starts a session; closes an older one of the same worker.
  Joined join(const Hello& hello, std::shared_ptr<WorkerConnection> connection);
  /// The stream ended.
  void disconnect(Session session);

  // Reports of a connected worker.
  void record_contact(Session session);
  void heartbeat(Session session, const std::vector<UnitName>& started, std::int64_t rss_bytes);
  void grant_credits(Session session, std::int32_t count);
  void begin_draining(Session session);
  void return_units(Session session, const std::vector<UnitName>& units, bool lacks_files = false);
  void fail_unit(Session session, const Lease& lease, std::int32_t tile, Failure failure,
                 absl::StatusCode code);
  void scene_loaded(Session session, const std::string& job_id, const SceneLoad& load);
  void take_log_lines(Session session, const std::vector<LogLine>& lines);

  /// Returns the messages to send now; empty if the session has ended.
  Outbox take_outbox(Session session);
  /// A worker and the seconds since its last message; none for one that is only known by name.
  using Listed = std::pair<Worker, std::optional<double>>;
  /// Returns the workers that are connected or were within the last hour. Then absent ones about
  /// which decisions remain, of which only those are known: banned IDs and witnesses, and IDs of
  /// workers that are set aside.
  std::vector<Listed> list() const;

  /// Number of open connections.
  std::size_t connection_count(const FarmView& /*farm*/) const { return connections_.size(); }

  // Operators' orders.
  /// Drains a worker. Errors: NotFound, it is not connected.
  absl::Status drain_worker(const std::string& worker_id);
  using OnBanned = std::function<void(const absl::StatusOr<std::vector<std::string>>& workers)>;
  /// Bans a worker and all with its certificate durably, then calls `done` with the IDs of those
  /// that are known. Errors: NotFound, it was not connected within the last hour.
  void ban_worker(const std::string& worker_id, OnBanned done);
  /// Lifts a ban or quarantine durably, then calls `done`. Errors: NotFound, unknown worker without
  /// a ban.
  void allow_worker(const std::string& worker_id, std::function<void(absl::Status)> done);
  /// Records that a worker joined with a token, then calls `done`. Errors: as Store::record_join.
  void record_join(Join join, std::int64_t max_joins, std::function<void(absl::Status)> done);
  /// Returns the key with which a worker that has joined reconnects: an HMAC with the store's key
  /// over its ID and its certificate's name, so that no key is stored.
  std::string session_key(const std::string& worker_id, const std::string& certificate) const;

  void carry_out(FarmChange& change, const Effects& effects) override;

 private:
  struct OpenConnection {
    std::int64_t session = 0;
    std::shared_ptr<WorkerConnection> connection;  // owners: the stream and this table
  };

  bool is_open(const FarmView& farm, Session session) const;
  Worker* session_worker(FarmChange& change, Session session);
  void close_lost(FarmChange& change, WorkerKey key);
  void close_unread(FarmChange& change, WorkerKey key);
  void note_left(FarmChange& change, WorkerKey key);
  absl::StatusOr<std::vector<std::string>> ban_now(const std::string& worker_id);
  absl::Status allow_now(const std::string& worker_id);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  // Guarded by the farm's lock: functions that use them take a section of the farm.
  std::map<WorkerKey, OpenConnection> connections_;
  std::int64_t last_session_ = 0;
};

}  // namespace tessera::server
