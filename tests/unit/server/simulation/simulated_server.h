#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/coordinator/coordinator.h"
#include "server/store/store.h"
#include "tests/support/dice.h"
#include "tests/support/disk/power_cut.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/server/simulation/fairness_checks.h"
#include "tests/unit/server/simulation/simulated_network.h"

namespace tessera::server {

/// A coordinator over a real store, its clients and its workers, in one thread and in simulated
/// time. Everything follows from the seed.
///
/// The server is killed, and loses power between two disk operations; then data that was not synced
/// is missing, torn or zero. The disk is full at times. The wall clock jumps. Messages are delayed,
/// lost when their stream breaks, and overtake those of other streams and calls: the first message
/// of an abandoned stream arrives after that of the next one, a request after the one that repeats
/// it. Workers crash, and send blocks late or twice. Clients create, pause, resume, cancel, retry,
/// extend and remove jobs, and give up waiting for answers. In every second simulation of this kind
/// all units are audited, and one worker more delivers wrong pixels in every third block. In every
/// fourth simulation three owners share the farm instead: two have a large job each, the third one
/// of a lower priority.
///
/// run() checks after each step:
/// - What was acknowledged to a client or worker still holds: jobs exist once, in the state and
/// with
///   the sample count that their client was told; after a restart acknowledged units are committed.
/// - No unit is acknowledged as committed twice, and no committed unit is leased again, except for
///   an audit.
/// - No unit waits too long, and owners get their shares: see FairnessChecks.
/// - Memory stays within its limits; a worker holds no more units than it has granted credits.
/// - The scheduler's indexes match a recount.
/// At the end every job is done, with its units and their CPU time counted once and the pixels of
/// an undisturbed run, but for the few frames that no other worker could audit, of which the report
/// says so. No queue, worker or connection keeps anything of them.
class SimulatedServer {
 public:
  /// Counts of events and faults, so that a test can see that faults take place.
  struct Events {
    int crashes = 0, power_cuts = 0, full_disks = 0, refused_writes = 0, worker_crashes = 0,
        broken_streams = 0, lost_messages = 0, overtaken_messages = 0, late_hellos = 0,
        repeated_blocks = 0, full_ingests = 0, abandoned_requests = 0, lost_answers = 0, pauses = 0,
        cancels = 0, retries = 0, extensions = 0, removals = 0, commits = 0, wrong_blocks = 0,
        quarantines = 0, doubted_frames = 0, leases = 0, overdue_leases = 0, share_windows = 0;
  };

  explicit SimulatedServer(std::uint64_t seed);
  ~SimulatedServer();
  SimulatedServer(const SimulatedServer&) = delete;
  SimulatedServer& operator=(const SimulatedServer&) = delete;

  /// Runs the chaos and then, without faults, until all jobs are done. Returns the first violation,
  /// "" if there is none.
  std::string run();
  const Events& events() const { return events_; }

 private:
  class Link;
  struct Upload;
  /// A job as its client knows it.
  struct ClientJob {
    int kind = 0;
    std::string request_id;
    std::string id;                   // empty: not told yet
    int request = 0;                  // number of the last request
    bool is_pending = false;          // its answer is awaited
    bool is_alone = false;            // no earlier request was under way when it was sent
    int stray_count = 0;              // requests under way whose answers are not awaited
    bool is_uncertain = false;        // whether the last change is recorded is not known
    std::set<int> sample_counts;      // that it may have
    std::optional<JobState> must_be;  // until the next request
    bool may_be_gone = false, is_gone = false, is_done = false;
    bool is_extended = false;
  };
  /// A unit that a worker holds.
  struct Held {
    Lease lease;
    std::optional<Time> ready;  // it has begun, and is rendered then
    std::optional<Time> sent;
  };
  struct Computer {
    std::string id;
    bool is_up = false, is_faulty = false;
    int threads = 1, credits = 0;
    std::shared_ptr<Link> link;      // owners: this, the coordinator and messages; may be null
    bool is_connected = false;       // the server has welcomed it on this link
    Time opened;                     // when the link was
    std::shared_ptr<Upload> upload;  // owners: this, the server and messages; may be null
    std::map<UnitName, Held> held;
    std::pair<std::string, std::int32_t> scene;  // job and frame that it has loaded
  };
  /// An answer to a client, and the disk operation after which it was given.
  struct Answer {
    int operation = 0;
    std::function<void()> arrive;
  };

  void violate(const std::string& what);
  /// Prints what happens if the environment sets TESSERA_TRACE.
  void trace(const std::string& what) const;
  int operation() const { return static_cast<int>(disk_->events().size()); }
  void step(bool is_calm);
  void disturb();
  void check();
  void check_memory();
  void check_committed();
  bool is_settled();
  std::string check_end();
  std::string why_not_over();

  // Server.
  absl::Status start();
  void stop();
  void crash(int first_operation);
  void work_of_server(bool is_calm);
  void arrive_until(int operation);
  void send_answers();

  // Clients.
  void answer(std::function<void()> arrive);
  void call(ClientJob& job, std::function<void(int request)> arrive);
  bool note_answer(ClientJob& job, int request);
  void act_as_client();
  void create(ClientJob& job);
  void upload(int kind);
  void request(ClientJob& job);
  void change(ClientJob& job, JobAdmin::Change what);
  void extend(ClientJob& job);
  void remove(ClientJob& job);
  void finish_requests();
  bool is_over() const;
  void check_job(ClientJob& job);
  bool is_doubted(const std::string& job_id, int frame);
  std::string check_done(ClientJob& job);
  std::vector<std::string> pixels_of(const std::string& job_id);

  // Workers.
  void act_as_worker(Computer& computer, bool is_calm);
  void lose_connections(Computer& computer, bool is_calm);
  void work(Computer& computer, bool is_calm);
  void connect(Computer& computer);
  void leave(Computer& computer);
  void break_link(Link& link);
  void tell(const Computer& computer, std::function<void(Session)> arrive);
  void note_scene(Computer& computer, const UnitName& name);
  void read_outbox(Computer& computer, const Outbox& outbox);
  int give_back(Computer& computer, const std::vector<UnitName>& revoked);
  void take_lease(Computer& computer, const Lease& lease);
  void deliver(Computer& computer, const UnitName& name, Held& held, bool is_calm);
  void upload_block(Computer& computer, const BlockHeader& header, const std::string& bytes);

  // The server's ends of streams.
  void end(Link& link);
  void send_outboxes(bool is_calm);
  void note_sent(const Computer& computer, const Outbox& outbox);
  void receive(const std::shared_ptr<Upload>& upload, std::function<void()> take);
  void read(const std::shared_ptr<Upload>& upload);
  void read_uploads();

  testing::Dice dice_;
  const bool is_shared_;  // by three owners
  const bool is_audited_;
  ScratchFolder folder_;
  testing::DiskImage at_start_;  // the disk's contents when the server started
  std::unique_ptr<testing::PowerCutDisk> disk_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  Time now_{};
  std::int64_t ingest_bytes_ = 0, film_bytes_ = 0;  // limits
  SchedulePolicy policy_;
  bool uses_rows_ = false;  // for small blocks, images and assets
  std::int64_t wall_offset_us_ = 0;
  std::vector<Answer> answers_;
  std::map<std::string, ClientJob> jobs_;  // by request ID
  std::set<int> uploaded_;                 // scenes whose upload was acknowledged
  std::vector<Computer> computers_;
  SimulatedNetwork network_;
  std::vector<std::pair<Computer*, std::shared_ptr<Link>>> links_;  // that the server reads
  std::vector<std::shared_ptr<Upload>> uploads_;                    // likewise
  std::int64_t largest_block_ = 0;                                  // that was sent, bytes
  std::map<std::string, std::map<contract::Unit, Attempt>>
      committed_;  // acknowledged units, and the newest lease then, by job ID
  // Unfinished jobs since the start, by owner: after a crash, cancels that were not durable are
  // undone, and so there may be more jobs than the quota allows.
  std::map<std::string, int> allowed_jobs_;
  std::unique_ptr<FairnessChecks> fairness_;
  Events events_;
  std::string violation_;
};

}  // namespace tessera::server
