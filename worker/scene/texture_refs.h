#pragma once

#include <array>

#include "worker/scene/scene.h"

namespace tessera::render {

/// Every texture reference of a material.
std::array<TextureRef*, 18> texture_refs(Material& material);
std::array<const TextureRef*, 18> texture_refs(const Material& material);

}  // namespace tessera::render
