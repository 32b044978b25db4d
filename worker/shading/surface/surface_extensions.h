#pragma once

#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// bsdf_at() for a material with further extensions, whose textures it reads. `parameters` are
/// those of all materials, `frame` that of the base's normal.
Bsdf extended_bsdf_at(const ShadingScene& scene, const ShadingPoint& point,
                      const BsdfParameters& parameters, const BsdfFrame& frame, const Vec3f& wo,
                      float wavelength);

/// Share of a surface's emission that passes the layers above it on its way to `wo`.
float emission_passed_at(const ShadingScene& scene, const ShadingPoint& point, const Vec3f& wo);

}  // namespace tessera::render
