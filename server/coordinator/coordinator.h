#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "contract/film_block.h"
#include "contract/tile_grid.h"
#include "contract/traversal_counts.h"
#include "server/coordinator/block_index.h"
#include "server/coordinator/client_quota.h"
#include "server/film/film_cache.h"
#include "server/film/frame_summary.h"
#include "server/film/frame_writer.h"
#include "server/report/job_view.h"
#include "server/schedule/scheduler/scheduler.h"
#include "server/store/store.h"
#include "server/sync/mutex.h"
#include "server/telemetry/delivery_log.h"
#include "server/telemetry/event_log.h"
#include "server/telemetry/farm_metrics.h"
#include "telemetry/log/log.h"

namespace tessera::server {

/// Connection to a worker. Thread-safe, non-blocking, called without locks; the caller holds a
/// reference.
class WorkerConnection {
 public:
  virtual ~WorkerConnection() = default;
  /// The worker's outbox has messages: fetch them with Coordinator::take_outbox.
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

/// Description of a block, sent before its bytes.
struct BlockHeader {
  Lease lease;
  std::int32_t tile = 0;
  std::int64_t size_bytes = 0;  // of the encoded block
  contract::Digest sha256;
  double cpu_seconds = 0;
  contract::TraversalCounts cost = {};

  contract::Unit unit() const { return {lease.frame, tile, lease.pass}; }
};

/// Properties of a block whose header was accepted.
struct Admission {
  contract::FilmBlockShape shape;
  std::int32_t sample_count = 0;
};

/// A line of a worker's log about a job.
struct LogLine {
  std::string job_id;
  std::string text;
};

struct CoordinatorOptions {
  SchedulePolicy policy;
  std::int64_t film_memory_bytes = std::int64_t{1} << 30;
  std::int64_t ingest_bytes = std::int64_t{256} << 20;  // delivered and not committed
  std::int64_t quota_bytes = std::int64_t{1} << 40;     // of the store
  std::int64_t asset_quota_bytes = std::int64_t{64} << 30;
  std::int64_t job_retention_us = 0;  // age after its end at which a job is removed; 0: never
  ClientQuota client_quota;
  Duration tick_period = std::chrono::milliseconds(100);
  std::function<Time()> clock;  // monotonic
  /// Wall clock, µs since 1970: for time stamps and job retention only.
  std::function<std::int64_t()> wall_us;
  std::function<std::uint64_t()> random;  // for job IDs
  /// Parses a job's row: settings, manifest, limits. Errors: DataLoss.
  std::function<absl::StatusOr<JobSpec>(const JobRecord&)> read_spec;
  /// Serialises the request of a job with the sample count and target error of `spec`.
  std::function<std::string(const JobSpec& spec)> write_request;
  Log log;  // may be empty
  /// Owners: the coordinator and its creator, who may record into it too.
  std::shared_ptr<FarmMetrics> metrics = std::make_shared<FarmMetrics>();
};

/// State of the farm behind one lock. All methods are thread-safe.
///
/// Contains no gRPC: ThreadSanitizer cannot see into Debian's libgrpc, so the lock is below it,
/// where plain threads can test it. No lock is held during a disk operation: these run on two
/// threads, the writer (journal: groups of blocks, rows and tasks in order) and the film thread
/// (merging, images). Callbacks run on one of them without a lock, and must not block.
class Coordinator {
 public:
  /// Loads the jobs of the store. `store` must outlive the coordinator, which is its only writer.
  static absl::StatusOr<std::unique_ptr<Coordinator>> open(Store& store,
                                                           CoordinatorOptions options);
  ~Coordinator();

  // Threads --------------------------------------------------------------------------------------
  /// Body of the writer thread: journals what is pending, waiting for something if `wait`. Returns
  /// whether it did anything. Call from one thread only.
  bool run_writer(bool wait);
  /// Body of the film thread, like run_writer().
  bool run_film(bool wait);
  /// Runs timeouts, leases and balancing; call about every tick_period.
  void tick();
  /// Ends waiting rounds. Further rounds without waiting still process what is queued.
  void stop();
  bool is_stopping() const;

  // Workers --------------------------------------------------------------------------------------
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
  void record_contact(Session session);
  void heartbeat(Session session, const std::vector<UnitName>& started, std::int64_t rss_bytes);
  void grant_credits(Session session, std::int32_t count);
  void begin_draining(Session session);
  void return_units(Session session, const std::vector<UnitName>& units);
  void fail_unit(Session session, const Lease& lease, std::int32_t tile, Failure failure,
                 absl::StatusCode code);
  void scene_loaded(Session session, const std::string& job_id, const SceneLoad& load);
  /// Returns the messages to send now; empty if the session has ended.
  Outbox take_outbox(Session session);
  /// Returns workers that are connected or were lost within the last hour, each with the seconds
  /// since its last message.
  std::vector<std::pair<Worker, double>> workers() const;
  /// Returns a job's spec if units of it were leased to workers with this certificate (empty: any
  /// worker), else null.
  std::shared_ptr<const JobSpec> describe_job(const std::string& job_id,
                                              const std::string& certificate = {}) const;
  void take_log_lines(Session session, const std::vector<LogLine>& lines);
  /// Drains a worker. Errors: NotFound, it is not connected.
  absl::Status drain_worker(const std::string& worker_id);
  /// Bans a worker durably, then calls `done`. Errors: NotFound, it was not connected within the
  /// last hour.
  void ban_worker(const std::string& worker_id, std::function<void(absl::Status)> done);
  /// Lifts a ban or quarantine durably, then calls `done`. Errors: NotFound, unknown worker without
  /// a ban.
  void allow_worker(const std::string& worker_id, std::function<void(absl::Status)> done);
  /// Records that a worker joined with a token, then calls `done`. Errors: as Store::record_join.
  void record_join(Join join, std::int64_t max_joins, std::function<void(absl::Status)> done);
  /// Returns the key with which a worker that has joined reconnects: an HMAC with the store's key
  /// over its ID and its certificate's name, so that no key is stored.
  std::string session_key(const std::string& worker_id, const std::string& certificate) const;

  // Blocks ---------------------------------------------------------------------------------------
  /// Checks that a worker with this ID has a session under this certificate, and notes the contact.
  /// Errors: FailedPrecondition.
  absl::Status check_delivery(const std::string& worker_id, const std::string& certificate = {});
  /// Checks a block by its header. nullopt: it is acknowledged already and its bytes must be
  /// skipped.
  std::optional<Admission> admit(const std::string& worker_id, const BlockHeader& header);
  /// Takes an admitted block; its acknowledgement follows in the outbox. Checks the bytes before it
  /// takes the lock.
  void deliver(const std::string& worker_id, const BlockHeader& header, const Admission& admission,
               std::string bytes);
  /// Returns whether more blocks may be read now. If not, `resume` is called once there is room.
  bool has_room_or_call(std::function<void()> resume);

  // Jobs -----------------------------------------------------------------------------------------
  struct Created {
    JobView view;
    std::int64_t store_bytes = 0;
  };
  using OnCreated = std::function<void(absl::StatusOr<Created>)>;
  using OnJob = std::function<void(absl::StatusOr<JobView>)>;
  enum class Change { pause, resume, cancel, retry };

  /// Creates a job durably, then calls `done`. Errors: as CreateJob in job_service.proto.
  void create_job(JobSpec spec, OnCreated done);
  /// See tessera::server::check_client_priority().
  absl::Status check_client_priority(std::int32_t priority) const {
    return server::check_client_priority(options_.policy, priority);
  }
  /// Changes a job, journals it, then calls `done`. Errors: as the rpc of that name.
  void change_job(const std::string& job_id, Change change, const OnJob& done);
  /// New settings of an extended job; absent: unchanged.
  struct Extension {
    std::optional<std::int32_t> spp;
    std::optional<double> error;
  };
  void extend_job(const std::string& job_id, const Extension& extension, OnJob done);
  void remove_job(const std::string& job_id, std::function<void(absl::Status)> done);
  /// Finds a job by ID, unique prefix, name or `last`. Errors: NotFound, InvalidArgument.
  absl::StatusOr<JobView> find_job(const std::string& text, const std::string& owner = {}) const;
  /// Errors: NotFound, no such job, or it belongs to another owner.
  absl::Status check_owner(const std::string& job_id, const std::string& owner) const;
  /// Finds a job by ID only. Errors: NotFound.
  absl::StatusOr<JobView> job(const std::string& job_id) const;
  /// Returns up to `limit` jobs older than `before` (0: from the newest), newest first.
  std::vector<JobView> list_jobs(JobKey before, std::int32_t limit,
                                 const std::string& owner = {}) const;
  absl::StatusOr<JobReport> report(const std::string& job_id) const;
  /// Recent events.
  const EventLog& events() const { return events_; }
  /// Returns up to `limit` recent deliveries of a job after a sequence. Errors: NotFound.
  absl::StatusOr<std::vector<Delivery>> deliveries(const std::string& job_id, std::int64_t after,
                                                   std::size_t limit) const;
  /// Returns the metrics for Prometheus. Visits all jobs and workers under the lock.
  std::vector<prometheus::MetricFamily> metrics() const;
  /// Finds or creates a frame's image file on the film thread, then calls `done`. The caller
  /// removes a temporary file. Errors: as FetchFrame.
  void fetch_frame(const FrameQuery& query, std::function<void(absl::StatusOr<FrameFile>)> done);

  // Assets ---------------------------------------------------------------------------------------
  /// Returns whether the asset exists; protects it from deletion for an hour.
  bool has_asset(const contract::Digest& digest);
  absl::StatusOr<std::string> new_upload_path() { return store_.new_upload_path(); }
  void publish_asset(const std::string& upload_path, const contract::Digest& digest,
                     std::function<void(absl::Status)> done);
  std::string asset_path(const contract::Digest& digest) const { return store_.asset_path(digest); }
  /// Returns whether a job of which units were leased to workers with this certificate refers to
  /// the asset.
  bool is_leased_asset(const contract::Digest& digest, const std::string& certificate) const;

 private:
  /// A delivered block that waits for the writer.
  struct Delivered {
    std::string worker_id;
    BlockHeader header;
    contract::FilmBlock block;
    std::string bytes;
  };
  /// Images and progress of a job, apart from its schedule.
  struct JobFilm {
    std::shared_ptr<const contract::TileGrid> grid;  // owners: the job and current users
    std::optional<BlockIndex> block_index;
    std::map<std::int32_t, FrameRecord> finished;
    std::set<std::int32_t> finishing;  // complete, image being written
    std::int64_t committed_samples = 0;
    std::int64_t samples_at_start = 0;  // committed before this process started
    // With a target error: samples of finished frames, and predictions for the others.
    std::int64_t finished_samples = 0;
    std::map<std::int32_t, std::int64_t> expected_samples;
    std::optional<Certainty> certainty;  // the worst of the finished frames

    std::vector<std::string> warnings;  // frames finished with units of a faulty worker

    double wall_at_start = 0;
    std::optional<double> estimated_error;
    std::int64_t create_time_us = 0, end_time_us = 0;
  };
  struct OpenConnection {
    std::int64_t session = 0;
    std::shared_ptr<WorkerConnection> connection;  // owners: the stream and this table
  };
  /// Callbacks run after unlocking. Declare before the MutexLock.
  class DeferredCalls {
   public:
    DeferredCalls() = default;
    ~DeferredCalls() {
      for (const auto& call : calls_) call();
    }
    DeferredCalls(const DeferredCalls&) = delete;
    DeferredCalls& operator=(const DeferredCalls&) = delete;
    void add(std::function<void()> call) { calls_.push_back(std::move(call)); }

   private:
    std::vector<std::function<void()>> calls_;
  };
  /// A committed unit to merge; without a block, only its commit is noted.
  struct FilmUpdate {
    std::string job_id;
    contract::Unit unit;
    std::optional<contract::FilmBlock> block;
    std::int64_t bytes = 0;
  };
  struct CheckedGroup;  // a group of delivered blocks with their outcomes

  Coordinator(Store& store, CoordinatorOptions options, const std::vector<std::string>& roster);

  absl::Status load(const std::vector<JobRecord>& records, const std::vector<std::string>& banned);
  absl::Status load_job(const JobRecord& record) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status load_units(Job& job, const JobRecord& record) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void apply_effects(DeferredCalls& deferred) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void journal_running() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void remove_old_jobs() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Worker* session_worker(Session session) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  JobFilm& job_film(const Job& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  const contract::TileGrid& tile_grid(const Job& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  BlockIndex& open_block_index(Job& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  JobView view(const Job& job) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  static std::int64_t sample_count(const Job& job, const JobFilm& film);
  static void count_finished(JobFilm& film, const FrameRecord& record, const FrameSummary& summary);
  JobRecord record(const Job& job) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::string new_job_id() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void acknowledge(const std::string& worker_id, const std::string& job_id,
                   const contract::Unit& unit, AckStatus status, const std::string& reason)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void reject(const std::string& worker_id, const BlockHeader& header, const std::string& reason,
              DeferredCalls& deferred) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void answer_obsolete(const std::string& worker_id, const BlockHeader& header)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool handle_duplicate(Job& job, const std::string& worker_id, const BlockHeader& header)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  void post_to_writer(std::function<void()> task);
  void post_to_film(std::function<void()> task);
  void enqueue_film(std::function<void()> task) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void journal_changes();
  bool commit_group();
  void check_group(std::vector<Delivered>& group, CheckedGroup& checked);
  void apply_commit(CheckedGroup& checked);
  void count_committed(Job& job, const UnitRecord& record, std::int64_t samples)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::optional<double> turnaround_seconds(Job& job, const UnitRecord& record)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void commit_failed(const CheckedGroup& checked, const absl::Status& status);
  void pause_for_room(Job& job, const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void create_now(const JobSpec& spec, const OnCreated& done);
  absl::Status check_room(const JobSpec& spec, std::int64_t need_bytes);
  absl::Status check_owners_quota(const JobSpec& spec) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void note_demand(Job& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool is_ready(const Job& job, std::int32_t frame) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void end_audits(const std::vector<UnitName>& units) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void quarantine_worker(const std::string& worker_id, DeferredCalls& deferred)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void redo_units_by_worker(const FrameKey& key, const std::string& worker_id);
  void finish_if_complete(Job& job, std::int32_t frame) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void finish_complete_frames(Job& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::StatusOr<std::shared_ptr<JobSpec>> spec_to_extend(const std::string& job_id,
                                                          const Extension& extension) const;
  void extend_now(const std::string& job_id, const Extension& extension, const OnJob& done);
  void replan(const std::string& job_id, const std::shared_ptr<const JobSpec>& spec,
              const std::vector<UnitRecord>& kept);
  void open_films(Job& job) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status forget_job(const std::string& job_id, std::vector<contract::Digest>& assets);
  void remove_now(const std::string& job_id, const std::function<void(absl::Status)>& done);
  void collect_assets();

  void merge(FilmUpdate update);
  ReferenceReader reference_reader(const JobSpec& spec, std::int32_t frame);
  void open_film(const FrameKey& key);
  absl::StatusOr<contract::FilmBlock> read_block(const std::string& job_id,
                                                 const contract::Unit& unit);
  void decide(const FrameKey& key);
  void estimate(const FrameKey& key);
  void finish_frame(const FrameKey& key);
  absl::StatusOr<FrameRecord> write_finished(const FrameKey& key, const JobSpec& spec);
  void record_frame(const FrameKey& key, const FrameRecord& record, double error);
  absl::StatusOr<FrameFile> make_frame_file(const FrameQuery& query);
  absl::StatusOr<FrameFile> write_partial(const FrameQuery& query, const JobSpec& spec);
  void redo_units(const FrameKey& key, const std::vector<contract::Unit>& units,
                  bool reset_pass_targets = false);
  void frame_failed(const FrameKey& key, const absl::Status& status);
  void log(LogLevel level, const std::string& message) const;
  void note(EventKind kind, const Job& job, const std::string& worker_id, const std::string& text);
  void note(EventKind kind, const std::string& worker_id, const std::string& text);
  void note_state(const Job& job);
  void note_failure(const Job& job, const std::string& worker_id, const std::string& what,
                    const Failure& failure);

  Store& store_;
  const CoordinatorOptions options_;
  FilmCache film_;  // has its own lock, never taken under mutex_
  EventLog events_;
  DeliveryLog deliveries_;

  mutable Mutex mutex_;
  Scheduler scheduler_ ABSL_GUARDED_BY(mutex_);
  std::map<JobKey, JobFilm> films_ ABSL_GUARDED_BY(mutex_);
  std::map<WorkerKey, OpenConnection> connections_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, JobKey> job_by_request_ ABSL_GUARDED_BY(mutex_);
  std::map<contract::Digest, Time> asset_requests_ ABSL_GUARDED_BY(mutex_);
  std::int64_t last_session_ ABSL_GUARDED_BY(mutex_) = 0;

  ConditionVariable writer_wakeup_, film_wakeup_;
  std::vector<Delivered> delivered_ ABSL_GUARDED_BY(mutex_);
  std::int64_t ingest_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // delivered, or committed and not merged
  std::vector<std::function<void()>> resumes_ ABSL_GUARDED_BY(mutex_);
  std::set<JobKey> changed_ ABSL_GUARDED_BY(mutex_);
  std::set<JobKey> unjournaled_ ABSL_GUARDED_BY(mutex_);  // changes that could not be written
                                                          // because the disk was full
  std::vector<std::pair<std::string, bool>> roster_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::function<void()>> after_journal_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::function<void()>> write_tasks_ ABSL_GUARDED_BY(mutex_);
  std::deque<std::function<void()>> film_tasks_ ABSL_GUARDED_BY(mutex_);
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;
  Time last_running_journal_ ABSL_GUARDED_BY(mutex_);
  Time last_retention_check_ ABSL_GUARDED_BY(mutex_);

  // Film thread only.
  std::map<FrameKey, Time> last_estimate_;
  std::vector<contract::Unit> damaged_;  // of the frame being finished
  std::int64_t partial_count_ = 0;
};

}  // namespace tessera::server
