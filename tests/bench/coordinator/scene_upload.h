#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

#include "tessera/v1/asset_service.grpc.pb.h"
#include "tessera/v1/job_service.grpc.pb.h"

namespace tessera::bench {

/// Uploads a scene file; prints the reason and returns false if that fails.
bool upload(const std::shared_ptr<grpc::Channel>& channel, const std::string& token,
            const std::string& bytes);

/// The entry of a manifest for a file with these bytes.
v1::ManifestEntry manifest_entry(const std::string& uri, const std::string& bytes);

}  // namespace tessera::bench
