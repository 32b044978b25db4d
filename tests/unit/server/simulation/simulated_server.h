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

namespace tessera::server {

/// A coordinator over a real store, its clients and its workers, in one thread and in simulated
/// time. Everything follows from the seed.
///
/// The server is killed, and loses power between two disk operations; then data that was not synced
/// is missing, torn or zero. The disk is full at times. The wall clock jumps. Workers crash, lose
/// their streams, and send blocks late, twice or not at all. Clients create, pause, resume, cancel,
/// retry, extend and remove jobs, lose answers and repeat requests. In every second simulation all
/// units are audited, and one worker more delivers wrong pixels in every third block.
///
/// run() checks after each step that what was acknowledged to a client or worker still holds: jobs
/// exist once, in the state and with the sample count that their client was told; no committed unit
/// is leased again, except for an audit. At the end every job is done, with its units and their CPU
/// time counted once and the pixels of an undisturbed run, but for the few frames that no other
/// worker could audit, of which the report says so.
class SimulatedServer {
 public:
  /// Counts of events and faults, so that a test can see that faults take place.
  struct Events {
    int crashes = 0, power_cuts = 0, full_disks = 0, refused_writes = 0, worker_crashes = 0,
        broken_streams = 0, lost_blocks = 0, repeated_blocks = 0, lost_answers = 0, pauses = 0,
        cancels = 0, retries = 0, extensions = 0, removals = 0, commits = 0, wrong_blocks = 0,
        quarantines = 0, doubted_frames = 0;
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
  /// A job as its client knows it.
  struct ClientJob {
    int kind = 0;
    std::string request_id;
    std::string id;                   // empty: not told yet
    bool is_pending = false;          // a request is under way
    bool is_uncertain = false;        // whether the last change is recorded is not known
    std::set<int> sample_counts;      // that it may have
    std::optional<JobState> must_be;  // until the next request
    bool may_be_gone = false, is_gone = false, is_done = false;
    bool is_extended = false;
    std::set<UnitName> committed;  // units that a worker knows as committed
  };
  /// A unit that a worker holds.
  struct Held {
    Lease lease;
    std::optional<Time> ready;  // it has begun, and is rendered then
    std::optional<Time> sent;
  };
  struct Computer {
    std::string id;
    bool is_up = false, is_connected = false, is_faulty = false;
    int threads = 1, credits = 0;
    Session session;
    std::shared_ptr<Link> link;  // owners: the coordinator and the worker
    std::map<UnitName, Held> held;
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
  void check();
  std::string check_end();

  // Server.
  absl::Status start();
  void stop();
  void crash(int first_operation);
  void work_of_server(bool is_calm);
  void arrive_until(int operation);

  // Clients.
  void answer(std::function<void()> arrive);
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
  void connect(Computer& computer);
  void read_outbox(Computer& computer);
  int give_back(Computer& computer, const std::vector<UnitName>& revoked);
  void check_lease(const Computer& computer, const Lease& lease);
  void take_lease(Computer& computer, const Lease& lease);
  void deliver(Computer& computer, const UnitName& name, Held& held, bool is_calm);

  testing::Dice dice_;
  ScratchFolder folder_;
  testing::DiskImage at_start_;  // the disk's contents when the server started
  std::unique_ptr<testing::PowerCutDisk> disk_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  Time now_{};
  const bool is_audited_;
  bool uses_rows_ = false;  // for small blocks, images and assets
  std::int64_t wall_offset_us_ = 0;
  std::vector<Answer> answers_;
  std::map<std::string, ClientJob> jobs_;  // by request ID
  std::set<int> uploaded_;                 // scenes whose upload was acknowledged
  std::vector<Computer> computers_;
  Events events_;
  std::string violation_;
};

}  // namespace tessera::server
