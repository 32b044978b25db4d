#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/worker_service.grpc.pb.h"
#include "worker/agent/server/asset_cache.h"
#include "worker/agent/server/server_channel.h"
#include "worker/agent/units/agent_metrics.h"
#include "worker/ipc/descriptor.h"

namespace tessera::agent {

/// Everything a renderer needs to render a job.
struct JobInputs {
  v1::RenderSettings message;
  contract::RenderSettings settings;
  v1::SceneManifest manifest;
  std::vector<Descriptor> descriptors;  // as DescriptorReader expects them
};

/// Fetches job descriptions and their assets on its own thread, one job at a time.
class JobFetcher {
 public:
  /// Called on the fetcher's thread. Errors: NotFound, the job does not exist; others name the
  /// failed step.
  using Done = std::function<void(std::string job_id, absl::StatusOr<JobInputs> inputs)>;

  /// All arguments but `done` must outlive the fetcher.
  JobFetcher(ServerChannel& channel, AssetCache& cache, AgentMetrics& metrics, std::string token,
             Done done);
  /// Cancels the running call.
  ~JobFetcher();
  JobFetcher(const JobFetcher&) = delete;
  JobFetcher& operator=(const JobFetcher&) = delete;

  /// Queues a job.
  void fetch(const std::string& job_id);
  /// Keeps the description of a job that may be fetched; for another one the server is asked.
  void describe(const v1::JobDescription& job);
  /// Drops the description of a job that has ended.
  void forget(const std::string& job_id);

 private:
  void run();
  absl::StatusOr<JobInputs> fetch_once(const std::string& job_id);
  absl::StatusOr<v1::JobDescription> description(const std::string& job_id);
  absl::StatusOr<Descriptor> fetch_asset(const v1::AssetId& id);
  /// Runs a call and repeats it after UNAVAILABLE, with back-off, until it succeeds or the fetcher
  /// ends.
  absl::Status call(std::chrono::milliseconds timeout,
                    const std::function<absl::Status(grpc::ClientContext&)>& attempt);

  ServerChannel& channel_;
  AssetCache& cache_;
  AgentMetrics& metrics_;
  const std::string token_;
  const Done done_;
  std::mutex mutex_;  // guards what follows
  std::condition_variable wake_;
  std::deque<std::string> queue_;
  std::map<std::string, v1::JobDescription> descriptions_;  // by job, until it is fetched
  grpc::ClientContext* running_ = nullptr;
  bool ending_ = false;
  std::thread thread_;
};

}  // namespace tessera::agent
