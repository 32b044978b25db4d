#pragma once

#include <array>

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// The patterns of TESSERA_texture (docs/extensions.md): pure functions of a point and of how wide
/// a spot is seen there. What is finer than the spot gives its mean, octave by octave, so that
/// distance does not alias; between one and two features a spot it fades.

/// The pattern at `p` (x, y, z, time; in features, as the procedure's scale and offset make it),
/// before the ramp, in [0, 1]. `footprint`: width of the spot in features; 0 for a point.
float pattern_at(const ProceduralTexture& procedure, const std::array<double, 4>& p, float footprint);

/// The ramp at `value`, linear between its stops.
Vec4f ramp_at(const ProceduralTexture& procedure, float value);

/// Both, for a point in the procedure's space: metres, or uv (z 0).
Vec4f procedure_color(const ProceduralTexture& procedure, const Vec3d& point, float footprint);

/// `point` in features, with the time.
std::array<double, 4> in_features(const ProceduralTexture& procedure, const Vec3d& point);

}  // namespace tessera::render
