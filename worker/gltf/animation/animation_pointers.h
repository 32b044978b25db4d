#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// KHR_animation_pointer: animations of any number of cameras, materials, lights and our own
/// extensions. The numbers are put into the JSON, which is then read again, so that an animated
/// number means what a written one means and is checked as strictly.

/// Adds the pointer channels of the file's animations to document.animations; those that name a
/// node's own transform or weights become ordinary channels. Requires read_core_model().
/// Errors: InvalidArgument "animations[i].channels[k]: ...".
absl::Status read_animation_pointers(const nlohmann::json& root, GltfModel& document);

/// Whether one of `animations` has a pointer channel.
bool has_pointers(const GltfModel& document, const std::vector<std::int32_t>& animations);

/// Sets the numbers in `root` that `animations` name to their values at `seconds`.
absl::Status animate_json(const GltfModel& document, const std::vector<std::int32_t>& animations,
                          double seconds, nlohmann::json& root);

}  // namespace tessera::render
