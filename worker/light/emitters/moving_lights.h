#pragma once

#include <optional>

#include "worker/geometry/ray.h"
#include "worker/light/tree/light_bounds.h"
#include "worker/scene/moved_pose.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Positions of moving lights during the exposure. Times are in [0, 1] of the exposure, as of rays.
/// Requires Scene::key_times.
///
/// Vertices of a triangle at a time; nullopt while its instance's transform is singular.
std::optional<Corners> corners_of(const Scene& scene, const TriangleId& id, float time);

/// Bounds of a triangle over the exposure, with its largest area at a key as `strength`.
///
/// Vertices v and transforms M are linear between keys, so M v moves along a parabola, which lies
/// in the convex hull of its Bezier points M0 v0, (M0 v1 + M1 v0) / 2 and M1 v1.
LightBounds bounds_of_moving(const Scene& scene, const TriangleId& id);

/// Bounds of a shape instance over the exposure, for a radiance of that luminance.
LightBounds bounds_of_moving(const Scene& scene, const Instance& instance, double radiance,
                             bool both_sides);

/// Bounds of a punctual light over the exposure.
LightBounds bounds_of_moving(const PunctualLight& light);

}  // namespace tessera::render
