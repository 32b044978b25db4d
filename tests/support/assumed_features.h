#pragma once

#include <cstdint>
#include <string_view>

#include "worker/accel/layout/isa.h"
#include "worker/accel/scene_accel.h"
#include "worker/scene/scene.h"

namespace tessera::testing {

/// How to trace a scene as though everything in it had `features` (bits of render::Feature): the
/// pixels are to be the same. What a renderer finds out about a scene it is told by
/// TraceOptions::assumed_features. What loading leaves out, the scene is given: factors a white texture (of
/// 2 x 2 texels, with coordinates) for kFeatureTextures, textures the transform that changes nothing,
/// vertices the colour white.
render::TraceOptions assume(std::uint32_t features, render::Scene* scene,
                       render::Isa isa = render::best_isa());

/// The feature that render::feature_names() calls so; 0 if there is none.
std::uint32_t feature_named(std::string_view name);

}  // namespace tessera::testing
