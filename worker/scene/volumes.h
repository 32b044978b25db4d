#pragma once

#include "worker/scene/scene.h"

namespace tessera::render {

/// KHR_materials_volume's absorption, -ln(attenuationColor) / attenuationDistance, 1/m; infinite
/// where the colour is 0.
Vec3f extinction_of(const Material& material);

/// Solids of index 1 that neither reflect nor tint are nothing but the ends of what they absorb
/// with. They become that, TESSERA_medium's boundaries: light from points and suns goes through
/// them, and a ball of clear glass of index 1 is no ball at all (hard case 41).
void convert_index_matched_solids(Scene& scene);

}  // namespace tessera::render
