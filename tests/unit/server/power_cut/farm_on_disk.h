#pragma once

#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "server/coordinator/coordinator.h"
#include "server/store/store.h"
#include "tests/support/power_cut.h"

namespace tessera::server {

/// A coordinator over a real store on a recording disk, with one worker and one client, all in one
/// thread. The worker "renders" blocks that are a function of the unit alone.
class FarmOnDisk {
 public:
  /// What the worker wrote down of a unit: when it sent it, and when it heard what became of it,
  /// in steps of the disk.
  struct WorkerEntry {
    Lease lease;
    int sent_step = 0;
    int acknowledged_step = -1;  // -1: never
    AckStatus status = AckStatus::rejected;
  };
  using WorkerLog = std::map<UnitName, WorkerEntry>;

  /// The disk's root exists.
  explicit FarmOnDisk(const std::string& root);
  ~FarmOnDisk();
  FarmOnDisk(const FarmOnDisk&) = delete;
  FarmOnDisk& operator=(const FarmOnDisk&) = delete;

  /// Starts the server on what the disk holds.
  absl::Status start();
  contract::Digest scene_digest() const;
  /// Uploads the scene unless it is there. Returns the step at which it was acknowledged.
  absl::StatusOr<int> upload_scene();
  /// Submits the one job there is; again and again is no harm. Returns its id.
  absl::StatusOr<std::string> submit();
  /// Connects the worker; it still has `held`, unacknowledged by an earlier process of the server.
  void connect(const WorkerLog& held);
  /// Works until the job has ended. Errors: DeadlineExceeded, it does not end.
  absl::Status work_off(const std::string& job_id);

  int step() const { return static_cast<int>(disk_.events().size()); }
  const std::vector<testing::DiskEvent>& events() const { return disk_.events(); }
  const WorkerLog& log() const { return log_; }
  /// Units leased to the worker since start().
  const std::set<UnitName>& leased() const { return leased_; }
  Coordinator& coordinator() { return *coordinator_; }
  Store& store() { return *store_; }

 private:
  class Link;

  void pump();
  void collect();
  void send(const UnitName& name, const Lease& lease);

  std::string root_;
  testing::PowerCutDisk disk_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  std::shared_ptr<Link> link_;  // owners: the coordinator and the worker
  Session session_;
  Time now_{};
  std::uint64_t random_ = 1;
  std::vector<std::pair<UnitName, Lease>> waiting_;  // leased or unacknowledged, not sent in this process
  std::set<UnitName> leased_;
  WorkerLog log_;
};

}  // namespace tessera::server
