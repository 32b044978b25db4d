#pragma once

#include <cstdint>
#include <string>

#include "contract/digest.h"
#include "rpc/protocol_version.h"
#include "tessera/v1/job_service.pb.h"

namespace tessera::server {

inline constexpr char kScene[] = "{\"asset\":{\"version\":\"2.0\"}}";

inline v1::AssetId id_of(const std::string& bytes) {
  v1::AssetId id;
  id.set_sha256(contract::sha256(bytes).binary());
  id.set_size_bytes(static_cast<std::int64_t>(bytes.size()));
  return id;
}

/// A job of 3 x 3 tiles over the asset kScene.
inline v1::CreateJobRequest request_of(const std::string& name, std::int32_t spp = 16) {
  v1::CreateJobRequest request;
  request.set_protocol_version(contract::kProtocolVersion);
  request.set_request_id("request-" + name);
  request.set_name(name);
  v1::RenderSettings& settings = *request.mutable_settings();
  settings.set_width_px(48);
  settings.set_height_px(40);
  settings.set_tile_px(16);
  settings.set_sample_count(spp);
  settings.set_max_depth(4);
  settings.set_fps(24);
  settings.set_filter_width_px(1);
  settings.set_environment_strength(1);
  settings.add_frames()->set_step(1);
  request.mutable_manifest()->set_scene_uri("scene.gltf");
  v1::ManifestEntry& entry = *request.mutable_manifest()->add_assets();
  entry.set_uri("scene.gltf");
  *entry.mutable_asset() = id_of(kScene);
  return request;
}

}  // namespace tessera::server
