#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/commit/commit_pipeline.h"
#include "server/frames/frame_finisher.h"
#include "server/intake/ingest_budget.h"
#include "server/report/job_view.h"
#include "server/settings/budgets.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"
#include "server/telemetry/delivery_log.h"

namespace tessera::server {

/// Jobs to list: those with one of the values of each set that is not empty.
struct JobFilter {
  std::string visible_owner = {};  // the only owner whose jobs the caller may see; empty: all
  std::set<std::string> owners = {}, projects = {}, pools = {};
  std::set<JobState> states = {};
};

/// Part of a list of jobs, newest first.
struct JobPage {
  std::vector<JobView> jobs;
  JobKey before = 0;  // the next page begins with the job before this one; 0: this is the last page
};

/// Answers questions about jobs and the farm; changes nothing. Thread-safe.
class FarmQueries {
 public:
  /// The parts must outlive the queries.
  struct Parts {
    FarmState& farm;
    const Store& store;
    CommitPipeline& pipeline;
    FrameFinisher& finisher;
    const IngestBudget& budget;
    const DeliveryLog& deliveries;
    const Budgets& budgets;
    /// Returns the size of the assets that count towards an owner's quota.
    std::function<std::int64_t(const std::string& owner)> asset_bytes;
  };
  explicit FarmQueries(Parts parts) : parts_(std::move(parts)) {}

  /// Finds a job by ID, unique prefix, name or `last`. Errors: NotFound, InvalidArgument.
  absl::StatusOr<JobView> find_job(const std::string& text, const std::string& owner = {}) const;
  /// Errors: NotFound, no such job, or it belongs to another owner.
  absl::Status check_owner(const std::string& job_id, const std::string& owner) const;
  /// Finds a job by ID only. Errors: NotFound.
  absl::StatusOr<JobView> job(const std::string& job_id) const;
  /// Jobs that one call of list_jobs() visits at most, because it holds the farm's lock.
  static constexpr std::int32_t kMaxVisitedJobs = 4096;
  /// Returns up to `limit` jobs older than `before` (0: from the newest). A page may hold fewer
  /// jobs, or none, and not be the last. Requires limit > 0.
  JobPage list_jobs(JobKey before, std::int32_t limit, const JobFilter& filter = {}) const;
  /// Returns a job's spec if units of it were leased to workers with this certificate (empty: any
  /// worker), else null.
  std::shared_ptr<const JobSpec> describe_job(const std::string& job_id,
                                              const std::string& certificate = {}) const;
  /// Reads the statistics of finished frames from the store. Errors: NotFound; those of the store.
  absl::StatusOr<JobReport> report(const std::string& job_id) const;
  /// Returns up to `limit` recent deliveries of a job after a sequence. Errors: NotFound.
  absl::StatusOr<std::vector<Delivery>> deliveries(const std::string& job_id, std::int64_t after,
                                                   std::size_t limit) const;
  /// Runs `act`, which must not block, once the events of all calls answered so far are visible.
  void after_answers(std::function<void()> act) const {
    parts_.pipeline.after_answers(std::move(act));
  }
  /// Returns events that the store keeps, oldest first, up to `limit`. May be slow. Errors: those
  /// of the store.
  absl::StatusOr<std::vector<Event>> stored_events(const EventQuery& query,
                                                   std::size_t limit) const {
    return parts_.store.events().read(query, limit);
  }
  /// Sequence up to which events are no longer kept.
  std::int64_t last_dropped_event() const { return parts_.store.events().last_dropped(); }
  /// Returns what jobs used. May be slow. Errors: those of the store.
  absl::StatusOr<std::vector<UsageSum>> usage(const UsageQuery& query, std::size_t limit) const {
    return parts_.store.usage().read(query, limit);
  }
  /// Returns what each of these clients, and each owner of a job, uses of its quotas of jobs and
  /// files.
  std::map<std::string, OwnerUse> quota_use(const std::set<std::string>& clients = {}) const;
  /// Returns the metrics for Prometheus. Visits all jobs and workers in one section.
  std::vector<prometheus::MetricFamily> metrics() const;

 private:
  const Parts parts_;
};

}  // namespace tessera::server
