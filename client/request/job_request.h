#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/api/farm_client.h"
#include "client/local_farm/private_folder.h"
#include "client/output/image_file.h"
#include "client/request/render_options.h"

namespace tessera::client {

/// A job ready for submission, with the files of its assets.
struct PreparedJob {
  v1::CreateJobRequest request;              // complete except for request_id
  std::map<std::string, std::string> files;  // path of each asset by its SHA-256 (32 bytes)
  std::vector<std::string> remarks;          // warnings and notes about the scene
  std::vector<Image> references;             // one per frame, of its window; or none
  std::shared_ptr<PrivateFolder> folder;     // holds the references' asset files
};

/// Inspects the scene, computes the digests of its files and builds the request.
///
/// Errors: InvalidArgument, errors in the scene or the options, one per line; those of
/// inspect_scene and read_references.
absl::StatusOr<PreparedJob> prepare_job(const RenderOptions& options, const std::string& name);

/// Uploads the assets that the server does not have. Errors: those of FarmClient.
absl::Status upload_missing(FarmClient& client, const PreparedJob& job);

/// Returns a request ID that is a digest of settings, manifest and name: the same for the same job,
/// regardless of references and scene warnings.
std::string derived_request_id(const v1::CreateJobRequest& request);

/// Returns a random request ID.
std::string random_request_id();

}  // namespace tessera::client
