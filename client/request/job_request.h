#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/api/farm_client.h"
#include "client/output/image_file.h"
#include "client/local_farm/private_folder.h"
#include "client/request/render_options.h"

namespace tessera::client {

/// A job ready to be made, and where the bytes of its assets are.
struct PreparedJob {
  v1::CreateJobRequest request;              // all but the request id
  std::map<std::string, std::string> files;  // path of each asset, by its SHA-256 (32 bytes)
  std::vector<std::string> remarks;          // on the scene, for people: warnings and notes
  std::vector<Image> references;             // of each frame's window, in their order; or none
  std::shared_ptr<PrivateFolder> folder;     // where those lie as assets
};

/// Inspects the scene, takes the digests of its files and puts the request together.
///
/// Errors: InvalidArgument, what is wrong with the scene or the options, one line each; those of
/// inspect_scene and read_references.
absl::StatusOr<PreparedJob> prepare_job(const RenderOptions& options, const std::string& name);

/// Sends the assets the farm lacks. Errors: those of FarmClient.
absl::Status upload_missing(FarmClient& client, const PreparedJob& job);

/// A request id that the same job gets every time, with references or without and whatever is said
/// of its scene: a digest of settings, manifest and name.
std::string derived_request_id(const v1::CreateJobRequest& request);

/// One that no other job gets.
std::string random_request_id();

}  // namespace tessera::client
