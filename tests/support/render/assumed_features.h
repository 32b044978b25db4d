#pragma once

#include <cstdint>
#include <string_view>

#include "worker/accel/layout/isa.h"
#include "worker/accel/scene_accel.h"
#include "worker/scene/scene.h"

namespace tessera::testing {

/// Returns the options that trace a scene as if everything in it had `features` (bits of
/// render::Feature); the pixels must be the same. Features that the renderer detects are set in
/// TraceOptions::assumed_features. Features that loading removes are added to the scene: for
/// kFeatureTextures a white texture of 2 x 2 texels with coordinates for each factor, an identity
/// transform for textures, white vertex colours.
render::TraceOptions assume(std::uint64_t features, render::Scene* scene,
                            render::Isa isa = render::best_isa());

/// The feature with this name in render::feature_names(); 0 if there is none.
std::uint64_t feature_named(std::string_view name);

}  // namespace tessera::testing
