#pragma once

#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Colour of the procedural texture `f` of `ref` at a point of a surface.
Vec4f procedural_color_at(const ShadingScene& scene, const ShadingPoint& point,
                          const TextureRef& ref, const ProceduralTexture& f);

/// Bump mapping: `normal` (world, unit) perturbed for a surface displaced by the texture's bump
/// height times its red channel, times `scale`. Source: J. Blinn, "Simulation of wrinkled
/// surfaces", 1978.
Vec3f procedural_bumped(const ShadingScene& scene, const ShadingPoint& point, const TextureRef& ref,
                        const ProceduralTexture& f, float scale, const Vec3f& normal);

}  // namespace tessera::render
