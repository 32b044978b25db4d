#include "worker/geometry/shapes/make_shape.h"

#include <limits>
#include <utility>

#include "worker/math/float_bits.h"

namespace tessera::render {
namespace {

/// The smallest box of floats around a box of finite doubles.
Box3f enclosing_floats(const Box3d& box) {
  Box3f out;
  for (int k = 0; k < 3; ++k) {
    const auto lo = static_cast<float>(box.lo[k]), hi = static_cast<float>(box.hi[k]);
    out.lo[k] = double{lo} <= box.lo[k] ? lo : next_down(lo);
    out.hi[k] = double{hi} >= box.hi[k] ? hi : next_up(hi);
  }
  return out;
}

Box3d centered_box(const Vec3d& half) {
  return {-half, half};
}

/// The quadric of revolution x^2 + z^2 + yy y^2 + 2 y_linear y + constant = 0, clipped in y.
Shape make_surface_of_revolution(double yy, double y_linear, double constant, const Vec3d& half,
                                 bool capped) {
  Shape shape;
  shape.capped = capped;
  shape.quadric.squares = {1, yy, 1};
  shape.quadric.linear = {0, y_linear, 0};
  shape.quadric.constant = constant;
  shape.clip.lo = {-std::numeric_limits<double>::infinity(), -half.y,
                   -std::numeric_limits<double>::infinity()};
  shape.clip.hi = -shape.clip.lo;
  shape.bounds = enclosing_floats(centered_box(half));
  return shape;
}

}  // namespace

Shape make_ellipsoid(const Vec3d& radii) {
  Shape shape;
  // Scaled by the square of the largest radius, so that a sphere is x^2 + y^2 + z^2 = r^2.
  const double largest = max_component(radii);
  for (int k = 0; k < 3; ++k) {
    const double ratio = largest / radii[k];
    shape.quadric.squares[k] = ratio * ratio;
  }
  shape.quadric.constant = -largest * largest;
  shape.latitudes = true;
  shape.clip.lo = Vec3d{-1, -1, -1} * std::numeric_limits<double>::infinity();
  shape.clip.hi = -shape.clip.lo;
  shape.bounds = enclosing_floats(centered_box(radii));
  return shape;
}

Shape make_disc(double radius) {
  Shape shape = make_surface_of_revolution(0, 0, -radius * radius, {radius, 0, radius}, true);
  shape.clip.lo.y = shape.clip.hi.y = 0;
  return shape;
}

Shape make_rectangle(double width, double depth) {
  return make_box({width, 0, depth});
}

Shape make_box(const Vec3d& size) {
  Shape shape;
  shape.quadric.constant = -1;  // everywhere inside
  shape.clip = centered_box(size * 0.5);
  shape.bounds = enclosing_floats(shape.clip);
  return shape;
}

Shape make_plane() {
  Shape shape = make_box(Vec3d{1, 1, 1} * (2 * kPlaneReach));
  shape.clip.hi.y = 0;
  shape.bounds.lo = Vec3f{-1, -1, -1} * std::numeric_limits<float>::infinity();
  shape.bounds.hi = -shape.bounds.lo;
  return shape;
}

Shape make_cylinder(double radius, double height, bool capped) {
  return make_surface_of_revolution(0, 0, -radius * radius, {radius, height * 0.5, radius}, capped);
}

Shape make_cone(double radius, double height, bool capped) {
  // x^2 + z^2 = s^2 (y - h/2)^2 with s = radius / height.
  const double s2 = (radius / height) * (radius / height), top = height * 0.5;
  return make_surface_of_revolution(-s2, s2 * top, -s2 * top * top, {radius, top, radius}, capped);
}

Shape make_paraboloid(double radius, double height, bool capped) {
  // x^2 + z^2 = r^2 (y + h/2) / h.
  const double s = radius * radius / height;
  return make_surface_of_revolution(0, -0.5 * s, -0.5 * s * height, {radius, height * 0.5, radius},
                                    capped);
}

Shape make_one_sheet_hyperboloid(double waist, double radius, double height, bool capped) {
  // x^2 + z^2 = w^2 + (r^2 - w^2) (2 y / h)^2.
  const double s = 4 * (radius - waist) * (radius + waist) / (height * height);
  return make_surface_of_revolution(-s, 0, -waist * waist, {radius, height * 0.5, radius}, capped);
}

Shape make_two_sheet_hyperboloid(double gap, double radius, double height, bool capped) {
  // x^2 + z^2 = s (y^2 - (g/2)^2), r^2 = s (h^2 - g^2) / 4.
  const double s = 4 * radius * radius / ((height - gap) * (height + gap));
  return make_surface_of_revolution(-s, 0, s * gap * gap * 0.25, {radius, height * 0.5, radius},
                                    capped);
}

Shape make_quadric(const Quadric& quadric, const Box3d& clip, bool capped) {
  Shape shape;
  shape.capped = capped;
  shape.quadric = quadric;
  shape.clip = clip;
  shape.bounds = enclosing_floats(clip);
  return shape;
}

Shape make_torus(double radius, double tube) {
  Shape shape;
  shape.form = Shape::Form::torus;
  shape.radius = radius;
  shape.tube = tube;
  shape.bounds = enclosing_floats(centered_box({radius + tube, tube, radius + tube}));
  return shape;
}

Shape make_blobs(std::vector<Blob> blobs, double threshold) {
  Shape shape;
  shape.form = Shape::Form::blobs;
  shape.blobs = std::make_shared<const BlobField>(std::move(blobs), threshold);
  shape.bounds = enclosing_floats(shape.blobs->bounds());
  return shape;
}

Shape make_terrain(const TerrainForm& form, double depth) {
  Shape shape;
  shape.form = Shape::Form::terrain;
  shape.terrain = std::make_shared<const TerrainField>(form);
  shape.capped = depth > 0;
  // Keeps the upper plane, and without a depth the lower one, away from the ground.
  const TerrainField::Range& range = shape.terrain->range(0, 0, 0);
  const double low = double{range.low}, high = double{range.high}, gap = 0.01 * form.height;
  shape.clip.lo = {-0.5 * form.size.x, depth > 0 ? -depth : low - gap, -0.5 * form.size.y};
  shape.clip.hi = {0.5 * form.size.x, high + gap, 0.5 * form.size.y};
  Box3d ground = shape.clip;
  if (!shape.capped) ground.lo.y = low;
  ground.hi.y = high;
  shape.bounds = enclosing_floats(ground);
  return shape;
}

}  // namespace tessera::render
