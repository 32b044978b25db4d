#include "tests/bench/coordinator/worker_calls.h"

#include <chrono>
#include <utility>

#include "absl/status/status.h"
#include "rpc/certificates/certificate_files.h"
#include "rpc/channel.h"
#include "rpc/rpc_status.h"

namespace tessera::bench {
namespace {

constexpr std::chrono::seconds kTimeout{20};

}  // namespace

WorkerCalls::WorkerCalls(const Channels& channels, std::string job_id, v1::AssetId scene,
                         Figures& figures)
    : workers_(v1::WorkerService::NewStub(channels.worker)),
      assets_(v1::AssetService::NewStub(channels.worker)),
      certificates_(v1::CertificateService::NewStub(channels.aged)),
      job_id_(std::move(job_id)),
      scene_(std::move(scene)),
      figures_(figures) {}

void WorkerCalls::call() {
  switch (turn_++ % 3) {
    case 0:
      timed(figures_, "DescribeJob", [&] { return describe_job(); });
      return;
    case 1:
      timed(figures_, "DownloadAsset", [&] { return download_asset(); });
      return;
    default:
      if (const auto key = contract::make_key(); key.ok()) {
        timed(figures_, "RenewCertificate", [&] { return renew(key->signing_request); });
      }
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

absl::Status WorkerCalls::renew(const std::string& signing_request) {
  grpc::ClientContext context;
  contract::prepare_call(context, "", kTimeout);
  v1::RenewCertificateRequest request;
  request.set_signing_request(signing_request);
  v1::RenewCertificateResponse response;
  return contract::from_rpc(certificates_->RenewCertificate(&context, request, &response));
}

}  // namespace tessera::bench
