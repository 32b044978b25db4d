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
#include "tessera/v1/job_service.pb.h"
#include "tessera/v1/worker_service.pb.h"

namespace tessera::client {

/// A farm's services. Every call retries UNAVAILABLE with exponential back-off and jitter, here and
/// nowhere else: for Connection::connect_timeout until the farm has answered once, then for 60 s, so that
/// a restart of the server goes unnoticed.
///
/// Errors of all calls: those of the rpc (proto/tessera/v1), Unavailable naming the address when
/// connect_timeout ends, Cancelled after cancel(). One thread at a time; cancel() from any.
class FarmClient {
 public:
  /// Errors: InvalidArgument, another machine's address without certificates; NotFound, no such
  /// token file or certificate; PermissionDenied, the certificate's key is not private.
  /// Sends nothing yet.
  static absl::StatusOr<std::unique_ptr<FarmClient>> connect(const Connection& connection);
  virtual ~FarmClient() = default;

  virtual absl::StatusOr<v1::CreateJobResponse> create_job(const v1::CreateJobRequest& request) = 0;
  /// `job`: id, unique prefix, name, or `last`. The other calls take the id found here.
  virtual absl::StatusOr<v1::Job> get_job(const std::string& job) = 0;
  virtual absl::StatusOr<v1::ListJobsResponse> list_jobs(const v1::ListJobsRequest& request) = 0;
  /// Calls `visit` with the job now and at every change, at most every `interval`, until it has
  /// ended or `visit` returns false. The last job seen.
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
  /// The report, a JSON document.
  virtual absl::StatusOr<std::string> get_report(const std::string& job_id) = 0;
  /// What workers delivered of a job, as far as the server remembers, in order.
  virtual absl::StatusOr<std::vector<v1::Delivery>> list_deliveries(const std::string& job_id) = 0;
  /// A frame's file: `start` once with its header, then `write` with its bytes in order. When the
  /// stream breaks and is retried, `start` is called again. A status they return ends the call.
  struct FrameSink {
    std::function<absl::Status(const v1::FrameHeader&)> start;
    std::function<absl::Status(std::string_view)> write;
  };
  virtual absl::Status fetch_frame(const v1::FetchFrameRequest& request, const FrameSink& sink) = 0;
  virtual absl::StatusOr<std::vector<v1::Worker>> list_workers() = 0;

  /// Those of `assets` that the farm lacks.
  virtual absl::StatusOr<std::vector<v1::AssetId>> find_missing_assets(
      const std::vector<v1::AssetId>& assets) = 0;
  /// Sends the file at `path`. Errors: NotFound, the file cannot be read; InvalidArgument, it has
  /// changed since its id was taken.
  virtual absl::Status upload_asset(const v1::AssetId& asset, const std::string& path) = 0;

  /// Ends the running call and all later ones with Cancelled.
  virtual void cancel() = 0;

  /// Calls `visit` with each event that fits, in order, until there are no more (with `follow`:
  /// for ever) or `visit` returns false.
  virtual absl::Status watch_events(v1::WatchEventsRequest request,
                                    const std::function<bool(const v1::Event&)>& visit) = 0;
  /// `worker_id`: the whole id.
  virtual absl::Status drain_worker(const std::string& worker_id) = 0;
  virtual absl::Status ban_worker(const std::string& worker_id) = 0;
  virtual absl::Status allow_worker(const std::string& worker_id) = 0;
};

}  // namespace tessera::client
