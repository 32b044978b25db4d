#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/coordinator/coordinator.h"
#include "server/store/store.h"
#include "tests/support/disk/power_cut.h"

namespace tessera::server {

/// A coordinator over a real store on a recording disk, with one worker and one client, all in one
/// thread. The worker's blocks depend only on the unit.
class FarmOnDisk {
 public:
  /// A unit in the worker's log: the disk steps at which it was sent and acknowledged.
  struct WorkerEntry {
    Lease lease;
    int sent_step = 0;
    int acknowledged_step = -1;  // -1: never
    AckStatus status = AckStatus::rejected;
  };
  using WorkerLog = std::map<UnitName, WorkerEntry>;

  /// `uses_rows`: scene, blocks and images are small enough for the database; otherwise they are
  /// files. Requires: the folder `root` exists.
  FarmOnDisk(const std::string& root, bool uses_rows);
  ~FarmOnDisk();
  FarmOnDisk(const FarmOnDisk&) = delete;
  FarmOnDisk& operator=(const FarmOnDisk&) = delete;

  /// Starts the server on the disk's contents.
  absl::Status start();
  contract::Digest scene_digest() const;
  /// Uploads the scene unless it is there. Returns the step at which it was acknowledged.
  absl::StatusOr<int> upload_scene();
  /// Submits the job, which may be repeated. Returns its id.
  absl::StatusOr<std::string> submit(const std::string& request_id = "request");
  /// Connects the worker, which still holds `held`, unacknowledged by an earlier server process.
  void connect(const WorkerLog& held);
  /// Renders until the job has ended. Errors: DeadlineExceeded, it does not end.
  absl::Status finish_job(const std::string& job_id);
  /// Lets the worker send a few blocks.
  void work();
  /// Orders of the client; each returns the server's answer.
  absl::Status change(const std::string& job_id, JobAdmin::Change what);
  absl::Status extend(const std::string& job_id, std::int32_t spp);
  absl::Status set_priority(const std::string& job_id, std::int32_t priority);
  absl::Status remove(const std::string& job_id);
  /// Returns the digest of each finished frame's pixels, or "damaged" if its file is.
  std::vector<std::string> pixels(const std::string& job_id);

  /// Number of disk operations so far.
  int step() const { return static_cast<int>(disk_.events().size()); }
  const std::vector<testing::DiskEvent>& events() const { return disk_.events(); }
  const WorkerLog& log() const { return log_; }
  /// Units leased to the worker since start().
  const std::set<UnitName>& leased() const { return leased_; }
  Coordinator& coordinator() { return *coordinator_; }
  Store& store() { return *store_; }
  testing::PowerCutDisk& disk() { return disk_; }

 private:
  class Link;

  void pump();
  void collect();
  void send(const UnitName& name, const Lease& lease);

  std::string root_;
  const bool uses_rows_;
  testing::PowerCutDisk disk_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  std::shared_ptr<Link> link_;  // owners: the coordinator and the worker
  Session session_;
  Time now_{};
  std::uint64_t random_ = 1;
  std::vector<std::pair<UnitName, Lease>> waiting_;  // leased or held, not sent by this process
  std::set<UnitName> leased_;
  WorkerLog log_;
};

}  // namespace tessera::server
