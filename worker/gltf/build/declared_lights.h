#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Whether the file lights the scene beneath `roots` at some time: a punctual light, were it dark
/// or hidden now, or an emissive material, were it hidden now or animated from darkness. A scene
/// that has none at all gets a sky; one that is dark for a while does not. `material_of` gives the
/// material of a primitive under the chosen variant, an index into document.materials or one past.
bool declares_light(const GltfModel& document, const std::vector<std::int32_t>& roots,
                    const std::function<std::int32_t(const GltfPrimitive&)>& material_of);

}  // namespace tessera::render
