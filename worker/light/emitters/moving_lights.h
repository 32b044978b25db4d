#pragma once

#include <optional>

#include "worker/geometry/ray.h"
#include "worker/light/tree/light_bounds.h"
#include "worker/scene/moved_pose.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Where things that shine and move are while the shutter is open: at a time in [0, 1], as rays of
/// that time meet them, and over all of it. Scene::key_times must have keys.

/// Of a triangle; nullopt while its instance is singular.
std::optional<Corners> corners_of(const Scene& scene, const TriangleId& id, float time);

/// Around a triangle all the while; as `strength`, its largest area at a key.
///
/// Vertices v and placements M are linear from each key to the next, so M v goes along a parabola,
/// which lies in the hull of its Bezier points M0 v0, (M0 v1 + M1 v0) / 2 and M1 v1.
LightBounds bounds_of_moving(const Scene& scene, const TriangleId& id);

/// Around an instance of a shape all the while, for a radiance of that luminance.
LightBounds bounds_of_moving(const Scene& scene, const Instance& instance, double radiance,
                             bool both_sides);

LightBounds bounds_of_moving(const PunctualLight& light);

}  // namespace tessera::render
