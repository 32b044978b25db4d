#pragma once

#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Colour of procedure `f`, which `ref` names, at a point of a surface.
Vec4f procedure_color_at(const ShadingScene& scene, const ShadingPoint& point,
                         const TextureRef& ref, const ProceduralTexture& f);

/// `normal` (world, unit) tilted as if the surface stood out by the procedure's bump height times
/// its red, times `scale`. Source: J. Blinn, "Simulation of wrinkled surfaces", 1978.
Vec3f procedure_bumped(const ShadingScene& scene, const ShadingPoint& point, const TextureRef& ref,
                       const ProceduralTexture& f, float scale, const Vec3f& normal);

}  // namespace tessera::render
