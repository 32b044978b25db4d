#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/problem.h"

namespace tessera::render {

/// Returns the first fault of a part that the nodes of `order` or `animations` use, apart from
/// materials; what a part depends on comes before it.
absl::Status check_used_parts(const GltfModel& model, const std::vector<std::int32_t>& order,
                              const std::vector<std::int32_t>& animations);

/// The same for a material, its textures and their images.
absl::Status check_used_material(const GltfModel& model, std::int32_t material);

/// Returns a warning for each faulty part. Requires that no used part has a fault.
std::vector<Problem> unused_part_warnings(const GltfModel& model);

}  // namespace tessera::render
