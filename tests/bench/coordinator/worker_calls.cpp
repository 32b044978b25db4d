#include "tests/bench/coordinator/worker_calls.h"

#include <chrono>
#include <utility>

#include "absl/status/status.h"
#include "rpc/channel.h"
#include "rpc/rpc_status.h"

namespace tessera::bench {
namespace {

constexpr std::chrono::seconds kTimeout{20};

}  // namespace

WorkerCalls::WorkerCalls(const std::shared_ptr<grpc::Channel>& channel, std::string job_id,
                         v1::AssetId scene, Figures& figures)
    : workers_(v1::WorkerService::NewStub(channel)),
      assets_(v1::AssetService::NewStub(channel)),
      job_id_(std::move(job_id)),
      scene_(std::move(scene)),
      figures_(figures) {}

void WorkerCalls::call() {
  if (turn_++ % 2 == 0) {
    timed(figures_, "DescribeJob", [&] { return describe_job(); });
  } else {
    timed(figures_, "DownloadAsset", [&] { return download_asset(); });
  }
}

absl::Status WorkerCalls::describe_job() {
  grpc::ClientContext context;
  contract::prepare_call(context, "", kTimeout);
  v1::DescribeJobRequest request;
  request.set_job_id(job_id_);
  v1::DescribeJobResponse response;
  return contract::from_rpc(workers_->DescribeJob(&context, request, &response));
}

absl::Status WorkerCalls::download_asset() {
  grpc::ClientContext context;
  contract::prepare_call(context, "", kTimeout);
  v1::DownloadAssetRequest request;
  *request.mutable_asset() = scene_;
  const auto stream = assets_->DownloadAsset(&context, request);
  v1::DownloadAssetResponse response;
  while (stream->Read(&response)) {
  }
  return contract::from_rpc(stream->Finish());
}

}  // namespace tessera::bench
