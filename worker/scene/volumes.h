#pragma once

#include "worker/scene/scene.h"

namespace tessera::render {

/// Absorption coefficient of KHR_materials_volume, -ln(attenuationColor) / attenuationDistance,
/// 1/m; infinite where the colour is 0.
Vec3f volume_absorption(const Material& material);

/// Turns solids of index 1 that neither reflect nor tint light into plain boundaries of
/// TESSERA_medium. Shadow rays then pass through them, so point and directional lights reach the
/// inside, and a clear ball of index 1 is invisible.
void convert_index_matched_solids(Scene& scene);

}  // namespace tessera::render
