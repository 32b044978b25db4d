#include "tests/bench/coordinator/scene_upload.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>

#include "contract/digest.h"
#include "rpc/channel.h"
#include "rpc/protocol_version.h"
#include "rpc/settings_message.h"

namespace tessera::bench {

bool upload(const std::shared_ptr<grpc::Channel>& channel, const std::string& token,
            const std::string& bytes) {
  grpc::ClientContext context;
  contract::prepare_call(context, token, std::chrono::seconds(20));
  v1::UploadAssetResponse response;
  auto writer = v1::AssetService::NewStub(channel)->UploadAsset(&context, &response);
  v1::UploadAssetRequest part;
  *part.mutable_asset() = asset_id(bytes);
  writer->Write(part);
  constexpr std::size_t kChunkBytes = 1 << 20;
  for (std::size_t at = 0; at < bytes.size(); at += kChunkBytes) {
    part.set_chunk(bytes.substr(at, kChunkBytes));
    if (!writer->Write(part)) break;  // Finish() says why
  }
  writer->WritesDone();
  const grpc::Status status = writer->Finish();
  if (!status.ok()) fprintf(stderr, "upload: %s\n", status.error_message().c_str());
  return status.ok();
}

v1::AssetId asset_id(const std::string& bytes) {
  v1::AssetId asset;
  asset.set_sha256(contract::sha256(bytes).binary());
  asset.set_size_bytes(static_cast<std::int64_t>(bytes.size()));
  return asset;
}

contract::RenderSettings small_settings(int tiles_across) {
  contract::RenderSettings settings;
  settings.width = settings.height = 8 * tiles_across;
  settings.tile = 8;
  settings.spp = 4;
  return settings;
}

v1::CreateJobRequest job_request(const std::string& name, const std::string& request_id,
                                 const contract::RenderSettings& settings,
                                 const v1::AssetId& scene) {
  constexpr char kFile[] = "bench.gltf";
  v1::CreateJobRequest request;
  request.set_protocol_version(contract::kProtocolVersion);
  request.set_request_id(request_id);
  request.set_name(name);
  *request.mutable_settings() = contract::to_message(settings);
  request.mutable_manifest()->set_scene_uri(kFile);
  v1::ManifestEntry& entry = *request.mutable_manifest()->add_assets();
  entry.set_uri(kFile);
  *entry.mutable_asset() = scene;
  return request;
}

}  // namespace tessera::bench
