#pragma once

#include <array>

#include "worker/scene/scene.h"

namespace tessera::render {

/// All texture references of a material, set or not.
std::array<TextureRef*, 18> texture_refs(Material& material);
std::array<const TextureRef*, 18> texture_refs(const Material& material);

}  // namespace tessera::render
