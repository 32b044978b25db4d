#pragma once

#include <vector>

#include "worker/geometry/shape.h"

namespace tessera::render {

/// Appends to `hits` all intersections of the line origin + t direction with the shape, by
/// ascending t of either sign; hits that are not requested may be missing. t is in multiples of the
/// direction, which need not be unit. A line that touches a closed shape may give two hits with the
/// same t. A direction that is zero or not finite gives none.
///
/// Computed in double relative to the point of the line nearest to the shape, so that distance does
/// not reduce precision; for a plane, whose t is a quotient of two heights, relative to the origin.
/// Source: E. Haines et al., "Precision improvements for ray/sphere
/// intersection", Ray Tracing Gems, 2019, chapter 7.
void intersect_shape(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits, const HitRequest& request = {});

/// intersect_shape() for these forms. Requires an `origin` near the shape.
void intersect_quadric(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                       std::vector<ShapeHit>& hits);
void intersect_torus(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits);

}  // namespace tessera::render
