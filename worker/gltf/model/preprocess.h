#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/file/container.h"
#include "worker/gltf/file/resource_reader.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Parses `text`. Requires the checks of split_container(). Errors: InvalidArgument with the
/// position.
absl::StatusOr<nlohmann::json> parse_json(std::string_view text);

/// Rejects unknown required extensions (Unimplemented, with their names), warns of unknown used
/// ones and runs check_tessera_extensions().
absl::Status check_extensions(const nlohmann::json& root, GltfModel& model);

/// Fills model.buffers from the GLB chunk, data URIs and `reader`, and lists files in
/// model.resources. Fallback buffers of EXT_meshopt_compression and faulty buffers stay empty.
absl::Status resolve_buffers(const nlohmann::json& root, const GltfContainer& container,
                             ResourceReader& reader, GltfModel& model);

/// The core model as text for tinygltf, without extensions, extras, buffers and images. Errors:
/// InvalidArgument for members of a type that tinygltf would misread or ignore; those of parts are
/// added to `faults`, and faulty parts are replaced by empty ones.
absl::StatusOr<std::string> core_text(const nlohmann::json& root, PartFaults& faults);

}  // namespace tessera::render
