#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/certificate_service.grpc.pb.h"
#include "tessera/v1/worker_service.grpc.pb.h"
#include "tests/bench/coordinator/rpc_figures.h"
#include "tests/bench/coordinator/scene_upload.h"

namespace tessera::bench {

/// The calls that a worker makes besides its streams, which simulated workers do not make. One
/// thread.
class WorkerCalls {
 public:
  struct Channels {
    /// With the certificate of the simulated workers, to which units of the job `job_id` are or
    /// were leased.
    std::shared_ptr<grpc::Channel> worker;
    /// With a certificate of which half of the validity has passed: the server renews no other.
    std::shared_ptr<grpc::Channel> aged;
  };
  /// `scene`: the file of the job's scene.
  WorkerCalls(const Channels& channels, std::string job_id, v1::AssetId scene, Figures& figures);

  /// Calls the next RPC.
  void call();

 private:
  absl::Status describe_job();
  absl::Status download_asset();
  absl::Status renew(const std::string& signing_request);

  const std::unique_ptr<v1::WorkerService::Stub> workers_;
  const std::unique_ptr<v1::AssetService::Stub> assets_;
  const std::unique_ptr<v1::CertificateService::Stub> certificates_;
  const std::string job_id_;
  const v1::AssetId scene_;
  Figures& figures_;
  int turn_ = 0;
};

}  // namespace tessera::bench
