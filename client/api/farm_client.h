#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/command.h"
#include "tessera/v1/asset_service.pb.h"
#include "tessera/v1/farm_service.pb.h"
#include "tessera/v1/job_service.pb.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::client {

/// Client of a server's services. Every call retries UNAVAILABLE with exponential back-off and
/// jitter: for Connection::connect_timeout until the server has answered once, then for 60 s, which
/// covers a restart of the server. No other code retries.
///
/// Errors of all calls: those of the RPC (proto/tessera/v1); Unavailable, naming the address, when
/// the retries time out; Cancelled after cancel(). One thread at a time; cancel() is thread-safe.
class FarmClient {
 public:
  /// Creates a client without contacting the server. Errors: InvalidArgument, the address is on
  /// another machine and there are no certificates; NotFound, the token file or a certificate does
  /// not exist; PermissionDenied, the key of the certificate is not private.
  static absl::StatusOr<std::unique_ptr<FarmClient>> connect(const Connection& connection);
  virtual ~FarmClient() = default;

  /// Connects on another thread, so that the first call need not wait for it. At most once, before
  /// any call.
  virtual void start_connecting() = 0;

  virtual absl::StatusOr<v1::CreateJobResponse> create_job(const v1::CreateJobRequest& request) = 0;
  /// `job`: ID, unique prefix, name, or `last`. Other calls require the ID.
  virtual absl::StatusOr<v1::Job> get_job(const std::string& job) = 0;
  virtual absl::StatusOr<v1::ListJobsResponse> list_jobs(const v1::ListJobsRequest& request) = 0;
  /// Calls `visit` with the current job and at every change, at most once per `interval`, until the
  /// job has ended or `visit` returns false. Returns the last job.
  virtual absl::StatusOr<v1::Job> watch_job(const std::string& job_id,
                                            std::chrono::milliseconds interval,
                                            const std::function<bool(const v1::Job&)>& visit) = 0;
  virtual absl::StatusOr<v1::Job> pause_job(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::Job> resume_job(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::Job> cancel_job(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::Job> retry_job(const std::string& job_id) = 0;
  virtual absl::Status remove_job(const std::string& job_id) = 0;
  virtual absl::StatusOr<v1::Job> extend_job(const std::string& job_id, std::int32_t sample_count,
                                             double error) = 0;
  virtual absl::StatusOr<v1::Job> update_job(const v1::UpdateJobRequest& request) = 0;
  /// Returns the report, a JSON document.
  virtual absl::StatusOr<std::string> get_report(const std::string& job_id) = 0;
  /// Returns the deliveries of a job that the server remembers, in order.
  virtual absl::StatusOr<std::vector<v1::Delivery>> list_deliveries(const std::string& job_id) = 0;
  /// Receiver of a frame's file: `start` is called with the header, then `write` with the bytes in
  /// order. If the call is retried, `start` is called again. An error status ends the call.
  struct FrameSink {
    std::function<absl::Status(const v1::FrameHeader&)> start;
    std::function<absl::Status(std::string_view)> write;
  };
  virtual absl::Status fetch_frame(const v1::FetchFrameRequest& request, const FrameSink& sink) = 0;
  virtual absl::StatusOr<std::vector<v1::Worker>> list_workers() = 0;

  /// Returns those of `assets` that the server does not have.
  virtual absl::StatusOr<std::vector<v1::AssetId>> find_missing_assets(
      const std::vector<v1::AssetId>& assets) = 0;
  /// Uploads the file at `path`. Errors: NotFound, the file cannot be read; InvalidArgument, its
  /// content does not match `asset`.
  virtual absl::Status upload_asset(const v1::AssetId& asset, const std::string& path) = 0;

  /// Makes the running call and all later ones return Cancelled.
  virtual void cancel() = 0;

  /// Calls `visit` with each matching event, in order, until there are no more (with `follow`:
  /// without end) or `visit` returns false.
  virtual absl::Status watch_events(v1::WatchEventsRequest request,
                                    const std::function<bool(const v1::Event&)>& visit) = 0;
  /// `worker_id`: the complete ID, as in the following calls.
  virtual absl::Status drain_worker(const std::string& worker_id) = 0;
  /// Returns the IDs of the banned workers: this one and those with its certificate.
  virtual absl::StatusOr<std::vector<std::string>> ban_worker(const std::string& worker_id) = 0;
  virtual absl::Status allow_worker(const std::string& worker_id) = 0;
  /// An empty pool: the one that the worker names itself.
  virtual absl::Status move_worker(const std::string& worker_id, const std::string& pool) = 0;
  virtual absl::Status set_aside_worker(const std::string& worker_id,
                                        const std::string& reason) = 0;
  virtual absl::Status bring_back_worker(const std::string& worker_id) = 0;

  virtual absl::StatusOr<v1::Limit> set_limit(const std::string& name, std::int64_t units) = 0;
  virtual absl::Status remove_limit(const std::string& name) = 0;
  virtual absl::StatusOr<std::vector<v1::Limit>> list_limits() = 0;

  virtual absl::StatusOr<v1::ClientShare> set_share(const std::string& name, double weight) = 0;
  virtual absl::StatusOr<v1::ClientShare> reset_share(const std::string& name) = 0;
  virtual absl::StatusOr<std::vector<v1::ClientShare>> list_shares() = 0;

  virtual absl::StatusOr<v1::Budget> set_budget(const v1::Budget& budget) = 0;
  virtual absl::Status remove_budget(v1::Budget::Scope scope, const std::string& name) = 0;
  virtual absl::StatusOr<std::vector<v1::Budget>> list_budgets() = 0;
  /// Returns all pages.
  virtual absl::StatusOr<std::vector<v1::Usage>> list_usage(v1::ListUsageRequest request) = 0;
  virtual absl::StatusOr<std::vector<v1::ClientQuotas>> list_quotas() = 0;
};

}  // namespace tessera::client
