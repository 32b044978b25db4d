#pragma once

#include <vector>

#include "worker/geometry/shapes/blob_field.h"
#include "worker/geometry/shapes/shape.h"
#include "worker/geometry/shapes/terrain_field.h"

namespace tessera::render {

/// Shapes about the origin; those of revolution about the y axis. All dimensions are above 0 and at
/// most 1e18. `capped` false leaves out the flat faces.
Shape make_ellipsoid(const Vec3d& radii);
/// In the plane y = 0, facing +y.
Shape make_disc(double radius);
/// The same, of this size along x and z.
Shape make_rectangle(double width, double depth);
Shape make_box(const Vec3d& size);
/// From y = -height / 2 to height / 2, as the others below unless they say otherwise.
Shape make_cylinder(double radius, double height, bool capped);
/// Its base below, its apex above.
Shape make_cone(double radius, double height, bool capped);
/// A bowl: its vertex below, `radius` wide at the top.
Shape make_paraboloid(double radius, double height, bool capped);
/// Of one sheet: `waist` wide in the middle, `radius` (more) at both ends.
Shape make_one_sheet_hyperboloid(double waist, double radius, double height, bool capped);
/// Of two sheets, which start `gap` (less than height) apart and are `radius` wide at the ends.
Shape make_two_sheet_hyperboloid(double gap, double radius, double height, bool capped);
/// Any quadric in any box that has thickness.
Shape make_quadric(const Quadric& quadric, const Box3d& clip, bool capped);
/// Requires tube < radius.
Shape make_torus(double radius, double tube);
/// Where the blobs (at least one) add up to the threshold (above 0). Its inside may be empty.
Shape make_blobs(std::vector<Blob> blobs, double threshold);
/// A height field; with a depth above 0 the block of ground from it down to y = -depth, else only
/// the surface.
Shape make_terrain(const TerrainForm& form, double depth);

}  // namespace tessera::render
