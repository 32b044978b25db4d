#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// KHR_animation_pointer: animates properties of cameras, materials, lights and TESSERA extensions.
/// Values are written into the JSON, which is then read again, so animated and static numbers have
/// the same meaning and the same checks.

/// Adds the pointer channels of the file's animations to model.animations; channels that name
/// the transform or weights of a node become ordinary ones. Requires read_core_model(). Errors:
/// InvalidArgument "animations[i].channels[k]: ...".
absl::Status read_animation_pointers(const nlohmann::json& root, GltfModel& model);

/// Returns whether one of `animations` has a pointer channel.
bool has_pointers(const GltfModel& model, const std::vector<std::int32_t>& animations);

/// Writes the values at `seconds` of all properties that `animations` animate into `root`.
absl::Status animate_json(const GltfModel& model, const std::vector<std::int32_t>& animations,
                          double seconds, nlohmann::json& root);

}  // namespace tessera::render
