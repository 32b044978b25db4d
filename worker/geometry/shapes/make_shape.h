#pragma once

#include <vector>

#include "worker/geometry/shape.h"
#include "worker/geometry/shapes/blobs/blob_field.h"
#include "worker/geometry/shapes/terrain/terrain_field.h"

namespace tessera::render {

// Shapes centred at the origin; surfaces of revolution have the y axis as their axis. Requires
// dimensions above 0 and at most 1e18. Shapes that are not `capped` lack their flat faces.

Shape make_ellipsoid(const Vec3d& radii);
/// In the plane y = 0, facing +y.
Shape make_disc(double radius);
/// In the plane y = 0, facing +y, `width` along x and `depth` along z.
Shape make_rectangle(double width, double depth);
Shape make_box(const Vec3d& size);
/// The plane y = 0, facing +y, as the top of a block that stands for the half-space below: its
/// other faces are kPlaneReach away, so that it is closed and every point on it is representable.
Shape make_plane();
inline constexpr double kPlaneReach = 1e12;
/// From y = -height / 2 to y = height / 2, as the cone, the paraboloid and the hyperboloids.
Shape make_cylinder(double radius, double height, bool capped);
/// The base is below, the apex above.
Shape make_cone(double radius, double height, bool capped);
/// A bowl with its vertex below and `radius` at the top.
Shape make_paraboloid(double radius, double height, bool capped);
/// Radius `waist` in the middle, `radius` at both ends. Requires waist < radius.
Shape make_one_sheet_hyperboloid(double waist, double radius, double height, bool capped);
/// The vertices of the sheets are `gap` apart; `radius` at both ends. Requires gap < height.
Shape make_two_sheet_hyperboloid(double gap, double radius, double height, bool capped);
/// A quadric clipped to a box. Requires a box with thickness along every axis.
Shape make_quadric(const Quadric& quadric, const Box3d& clip, bool capped);
/// Requires tube < radius.
Shape make_torus(double radius, double tube);
/// The region in which the sum of the blobs reaches the threshold; it may be empty. Requires at
/// least one blob and a threshold above 0.
Shape make_blobs(std::vector<Blob> blobs, double threshold);
/// A height field: with a depth above 0 the block of ground from it down to y = -depth, else only
/// the surface.
Shape make_terrain(const TerrainForm& form, double depth);

}  // namespace tessera::render
