#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "contract/render_settings.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::bench {

/// Uploads a scene file; prints the reason and returns false if that fails.
bool upload(const std::shared_ptr<grpc::Channel>& channel, const std::string& token,
            const std::string& bytes);

/// Returns the ID of a file with these bytes.
v1::AssetId asset_id(const std::string& bytes);
/// Returns the settings of a square image of tiles of 8 × 8 pixels, with 4 samples a pixel.
contract::RenderSettings small_settings(int tiles_across);
/// Returns a request for a job whose only file is `scene`.
v1::CreateJobRequest job_request(const std::string& name, const std::string& request_id,
                                 const contract::RenderSettings& settings,
                                 const v1::AssetId& scene);

}  // namespace tessera::bench
