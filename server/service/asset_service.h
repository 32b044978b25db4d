#pragma once

#include "server/coordinator/coordinator.h"
#include "server/service/access/access.h"
#include "server/sync/io_pool.h"
#include "tessera/v1/asset_service.grpc.pb.h"

namespace tessera::server {

/// gRPC front end of assets: checks and converts messages, maps errors.
class AssetService final : public v1::AssetService::CallbackService {
 public:
  /// Both must outlive the server this is registered with.
  AssetService(Coordinator& coordinator, const Access& access)
      : coordinator_(coordinator), access_(access) {}

  grpc::ServerUnaryReactor* FindMissingAssets(grpc::CallbackServerContext* context,
                                              const v1::FindMissingAssetsRequest* request,
                                              v1::FindMissingAssetsResponse* response) override;
  grpc::ServerReadReactor<v1::UploadAssetRequest>* UploadAsset(
      grpc::CallbackServerContext* context, v1::UploadAssetResponse* response) override;
  grpc::ServerWriteReactor<v1::DownloadAssetResponse>* DownloadAsset(
      grpc::CallbackServerContext* context, const v1::DownloadAssetRequest* request) override;

 private:
  absl::Status find_missing(const v1::FindMissingAssetsRequest& request,
                            v1::FindMissingAssetsResponse& response) const;
  bool may_read(const Caller& caller, const contract::Digest& digest) const;

  Coordinator& coordinator_;
  const Access& access_;
  IoPool io_{3};  // reads assets and writes small ones
  /// Writes large ones: one at a time, so that a commit waits for at most one sync of an upload.
  IoPool bulk_{1, IoPool::Priority::low};
};

}  // namespace tessera::server
