#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/file/container.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/gltf/file/resource_reader.h"

namespace tessera::render {

/// The first pass over the JSON: everything that must be settled before tinygltf sees it.

/// Parses `text`. Requires split_container()'s checks. Errors: InvalidArgument with the place.
absl::StatusOr<nlohmann::json> parse_json(std::string_view text);

/// Refuses unknown required extensions by name (Unimplemented), warns of unknown used ones; runs
/// check_tessera_extensions().
absl::Status check_extensions(const nlohmann::json& root, GltfModel& document);

/// Fills document.buffers from the GLB chunk, data URIs and `reader`; names files in
/// document.resources. Fallback buffers of EXT_meshopt_compression become empty.
absl::Status resolve_buffers(const nlohmann::json& root, const GltfContainer& container,
                             ResourceReader& reader, GltfModel& document);

/// The core model alone as text for tinygltf: no extensions, extras, buffers or images; every
/// member of a type that tinygltf would misread or ignore refused.
absl::StatusOr<std::string> core_text(const nlohmann::json& root);

}  // namespace tessera::render
