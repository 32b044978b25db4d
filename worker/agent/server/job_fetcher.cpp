#include "worker/agent/server/job_fetcher.h"

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "rpc/backoff.h"
#include "rpc/channel.h"
#include "rpc/rpc_status.h"
#include "rpc/settings_message.h"
#include "worker/agent/server/backoff.h"

namespace tessera::agent {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kCallTimeout{20'000}, kDownloadTimeout{0};
constexpr int kMaxAssets = 100'000;

}  // namespace

JobFetcher::JobFetcher(ServerChannel& channel, AssetCache& cache, AgentMetrics& metrics,
                       std::string token, Done done)
    : channel_(channel),
      cache_(cache),
      metrics_(metrics),
      token_(std::move(token)),
      done_(std::move(done)) {
  thread_ = std::thread([this] { run(); });
}

JobFetcher::~JobFetcher() {
  {
    const std::lock_guard lock(mutex_);
    ending_ = true;
    if (running_ != nullptr) running_->TryCancel();
  }
  wake_.notify_all();
  thread_.join();
}

void JobFetcher::fetch(const std::string& job_id) {
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(job_id);
  }
  wake_.notify_all();
}

void JobFetcher::describe(const v1::JobDescription& job) {
  const std::lock_guard lock(mutex_);
  descriptions_.insert_or_assign(job.job_id(), job);
}

void JobFetcher::forget(const std::string& job_id) {
  const std::lock_guard lock(mutex_);
  descriptions_.erase(job_id);
}

void JobFetcher::run() {
  while (true) {
    std::string job_id;
    {
      std::unique_lock lock(mutex_);
      wake_.wait(lock, [this] { return ending_ || !queue_.empty(); });
      if (ending_) return;
      job_id = std::move(queue_.front());
      queue_.pop_front();
    }
    auto inputs = fetch_once(job_id);
    done_(std::move(job_id), std::move(inputs));
  }
}

/// Returns the description that came with a lease, else asks the server.
absl::StatusOr<v1::JobDescription> JobFetcher::description(const std::string& job_id) {
  {
    const std::lock_guard lock(mutex_);
    auto known = descriptions_.extract(job_id);
    if (!known.empty()) return std::move(known.mapped());
  }
  v1::DescribeJobRequest request;
  request.set_job_id(job_id);
  v1::DescribeJobResponse response;
  const absl::Status status = call(kCallTimeout, [&](grpc::ClientContext& context) {
    return contract::from_rpc(channel_.workers()->DescribeJob(&context, request, &response));
  });
  if (!status.ok()) return status;
  v1::JobDescription job;
  *job.mutable_settings() = std::move(*response.mutable_settings());
  *job.mutable_manifest() = std::move(*response.mutable_manifest());
  return job;
}

absl::StatusOr<JobInputs> JobFetcher::fetch_once(const std::string& job_id) {
  auto job = description(job_id);
  if (!job.ok()) return job.status();
  auto settings = contract::from_message(job->settings());
  if (!settings.ok()) return settings.status();
  JobInputs inputs;
  inputs.settings = *std::move(settings);
  inputs.message = std::move(*job->mutable_settings());
  inputs.manifest = std::move(*job->mutable_manifest());
  if (inputs.manifest.assets_size() > kMaxAssets) {
    return absl::InvalidArgumentError(absl::StrCat("the job has ", inputs.manifest.assets_size(),
                                                   " assets; the maximum is ", kMaxAssets));
  }
  for (const v1::ManifestEntry& entry : inputs.manifest.assets()) {
    auto descriptor = fetch_asset(entry.asset());
    if (!descriptor.ok()) {
      return absl::Status(
          descriptor.status().code(),
          absl::StrCat(entry.uri(), ": ", std::string(descriptor.status().message())));
    }
    inputs.descriptors.push_back(*std::move(descriptor));
  }
  auto scratch = cache_.scratch();
  if (!scratch.ok()) return scratch.status();
  inputs.descriptors.push_back(*std::move(scratch));
  return inputs;
}

absl::StatusOr<Descriptor> JobFetcher::fetch_asset(const v1::AssetId& id) {
  const auto digest = contract::Digest::from_binary(id.sha256());
  if (!digest) return absl::InvalidArgumentError("asset ID without a SHA-256 digest");
  absl::StatusOr<Descriptor> result = absl::UnknownError("");
  bool is_cached = true;
  const absl::Status status = call(kDownloadTimeout, [&](grpc::ClientContext& context) {
    result = cache_.get(*digest, id.size_bytes(), [&](const auto& write) {
      is_cached = false;
      v1::DownloadAssetRequest request;
      *request.mutable_asset() = id;
      const auto stream = channel_.assets()->DownloadAsset(&context, request);
      v1::DownloadAssetResponse response;
      absl::Status kept;
      while (kept.ok() && stream->Read(&response)) kept = write(response.chunk());
      if (!kept.ok()) context.TryCancel();
      const grpc::Status finished = stream->Finish();
      return kept.ok() ? contract::from_rpc(finished) : kept;
    });
    return result.status();
  });
  if (!status.ok()) {
    metrics_.errors.asset_failed.Increment();
    return status;
  }
  (is_cached ? metrics_.assets.cache : metrics_.assets.server).Increment();
  if (!is_cached) metrics_.asset_bytes.Increment(static_cast<double>(id.size_bytes()));
  return result;
}

absl::Status JobFetcher::call(milliseconds timeout,
                              const std::function<absl::Status(grpc::ClientContext&)>& attempt) {
  contract::Backoff backoff(kFirstPause, kMaxPause);
  while (true) {
    grpc::ClientContext context;
    contract::prepare_call(context, token_, timeout);
    {
      const std::lock_guard lock(mutex_);
      if (ending_) return absl::CancelledError("the worker is shutting down");
      running_ = &context;
    }
    absl::Status status = attempt(context);
    std::unique_lock lock(mutex_);
    running_ = nullptr;
    if (!absl::IsUnavailable(status)) return status;
    wake_.wait_for(lock, backoff.next(), [this] { return ending_; });
  }
}

}  // namespace tessera::agent
