#include "tests/bench/coordinator/scene_upload.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdio>

#include "contract/digest.h"
#include "rpc/channel.h"

namespace tessera::bench {

bool upload(const std::shared_ptr<grpc::Channel>& channel, const std::string& token,
            const std::string& bytes) {
  grpc::ClientContext context;
  contract::prepare_call(context, token, std::chrono::seconds(20));
  v1::UploadAssetResponse response;
  auto writer = v1::AssetService::NewStub(channel)->UploadAsset(&context, &response);
  v1::UploadAssetRequest part;
  part.mutable_asset()->set_sha256(contract::sha256(bytes).binary());
  part.mutable_asset()->set_size_bytes(static_cast<std::int64_t>(bytes.size()));
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

v1::ManifestEntry manifest_entry(const std::string& uri, const std::string& bytes) {
  v1::ManifestEntry entry;
  entry.set_uri(uri);
  entry.mutable_asset()->set_sha256(contract::sha256(bytes).binary());
  entry.mutable_asset()->set_size_bytes(static_cast<std::int64_t>(bytes.size()));
  return entry;
}

}  // namespace tessera::bench
