#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Returns whether the file may light `scene` (kNone: none) with the nodes below `roots` at some
/// time: it has a punctual light or an emissive material or medium, possibly dark or hidden at the
/// moment. A scene without any gets a
/// default environment; one that is dark for a while does not. `material_of` returns the material
/// of a primitive under the chosen variant, an index into model.materials or one past it.
bool declares_light(const GltfModel& model, std::int32_t scene,
                    const std::vector<std::int32_t>& roots,
                    const std::function<std::int32_t(const GltfPrimitive&)>& material_of);

}  // namespace tessera::render
