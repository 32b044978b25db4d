#pragma once

#include <array>

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Patterns of TESSERA_texture (docs/reference/extensions/TESSERA_texture.md), as pure functions of
/// a point and a filter width (footprint). Octaves finer than the footprint fade to their mean
/// between one and two features per footprint, which prevents aliasing at a distance.

/// Pattern at `p` (x, y, z, time; in features, after scale and offset), before the colour ramp, in
/// [0, 1]. `footprint`: filter width in features; 0 for a point.
float pattern_at(const ProceduralTexture& procedural, const std::array<double, 4>& p,
                 float footprint);

/// Colour ramp at `value`, linear between its stops.
Vec4f ramp_at(const ProceduralTexture& procedural, float value);

/// Pattern and ramp for a point in the texture's space: metres, or uv (with z 0).
Vec4f procedural_color(const ProceduralTexture& procedural, const Vec3d& point, float footprint);

/// `point` in features, and the time.
std::array<double, 4> in_features(const ProceduralTexture& procedural, const Vec3d& point);

}  // namespace tessera::render
