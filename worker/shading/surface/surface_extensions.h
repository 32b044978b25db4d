#pragma once

#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// bsdf_at() for a material with extensions, whose textures it reads. `plain` are those of the core
/// material, `plain_frame` is that of the base normal.
Bsdf extended_bsdf_at(const ShadingScene& scene, const ShadingPoint& point,
                      const BsdfParameters& plain, const BsdfFrame& plain_frame, const Vec3f& wo,
                      float wavelength);

/// Fraction of a surface's emission towards `wo` that passes the layers above it.
float emission_passed_at(const ShadingScene& scene, const ShadingPoint& point, const Vec3f& wo);

}  // namespace tessera::render
