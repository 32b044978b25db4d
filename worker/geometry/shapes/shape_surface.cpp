#include "worker/geometry/shapes/shape_surface.h"

#include <cmath>

#include "worker/geometry/shapes/blobs/blob_field.h"
#include "worker/geometry/shapes/terrain/terrain_field.h"
#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr float kPi = 3.14159265358979323846f;
constexpr double kUnitRoundoff = 0x1p-24;

int axis_of(std::uint32_t face) {
  return static_cast<int>(face - 1) / 2;
}

Vec3d axis_vector(int axis, double length) {
  Vec3d v;
  v[axis] = length;
  return v;
}

Vec3d torus_normal(const Shape& shape, const Vec3d& p) {
  const double rho = std::sqrt(p.x * p.x + p.z * p.z);
  if (!(rho > 0)) return {0, p.y, 0};
  const double out = 1 - shape.radius / rho;
  return {p.x * out, p.y, p.z * out};
}

/// Position of x between low and high as a fraction, clamped to [0, 1].
float share(float x, float low, float high) {
  return high > low ? clamp((x - low) / (high - low), 0.0f, 1.0f) : 0.5f;
}

float height_angle(const Shape& shape, const Vec3f& p) {
  if (shape.form == Shape::Form::torus) {
    const float out = std::sqrt(p.x * p.x + p.z * p.z) - static_cast<float>(shape.radius);
    return 0.5f - elementary::atan2(p.y, out) / (2 * kPi);
  }
  if (shape.latitudes) {
    return elementary::acos(clamp(p.y / shape.bounds.hi.y, -1.0f, 1.0f)) / kPi;
  }
  return 1 - share(p.y, shape.bounds.lo.y, shape.bounds.hi.y);
}

/// The axes of u and v on a flat face, and whether they decrease along them. On vertical faces v
/// increases downwards.
struct FaceAxes {
  int u, v;
  bool u_falls, v_falls;
};

FaceAxes face_axes(std::uint32_t face) {
  const bool upper = face % 2 == 0;
  switch (axis_of(face)) {
    case 0:
      return {2, 1, upper, true};
    case 1:
      return {0, 2, false, !upper};
    default:
      return {0, 1, !upper, true};
  }
}

}  // namespace

Vec3d shape_normal(const Shape& shape, std::uint32_t face, const Vec3d& point) {
  if (face != kCurvedFace) return axis_vector(axis_of(face), face % 2 == 1 ? -1 : 1);
  if (shape.form == Shape::Form::torus) return torus_normal(shape, point);
  if (shape.form == Shape::Form::terrain) {
    const Vec2d slope = shape.terrain->slope({point.x, point.z});
    return {-slope.x, 1, -slope.y};
  }
  const Vec3d gradient = shape.form == Shape::Form::blobs
                             ? shape.blobs->outward_gradient(point)
                             : shape.quadric.times(point) + shape.quadric.linear;
  return gradient == Vec3d{} ? axis_vector(1, 1) : gradient;
}

Vec2f shape_uv(const Shape& shape, std::uint32_t face, const Vec3f& p) {
  if (face == kCurvedFace && shape.form == Shape::Form::terrain) {
    return {share(p.x, shape.bounds.lo.x, shape.bounds.hi.x),
            share(p.z, shape.bounds.lo.z, shape.bounds.hi.z)};
  }
  if (face == kCurvedFace) {
    return {0.5f + elementary::atan2(p.x, p.z) / (2 * kPi), height_angle(shape, p)};
  }
  const FaceAxes axes = face_axes(face);
  if (!shape.bounded()) return {p[axes.u], p[axes.v]};
  const auto along = [&](int axis, bool falls) {
    const float x = share(p[axis], shape.bounds.lo[axis], shape.bounds.hi[axis]);
    return falls ? 1 - x : x;
  };
  return {along(axes.u, axes.u_falls), along(axes.v, axes.v_falls)};
}

Vec4f shape_tangent(const Shape& shape, std::uint32_t face, const Vec3f& p) {
  // The direction of u, up and outwards form a right-handed frame everywhere; v increases
  // downwards.
  if (face == kCurvedFace) {
    return shape.form == Shape::Form::terrain ? Vec4f{1, 0, 0, -1} : Vec4f{p.z, 0, -p.x, -1};
  }
  const FaceAxes axes = face_axes(face);
  Vec3f tangent;
  tangent[axes.u] = axes.u_falls ? -1.0f : 1.0f;
  return {tangent.x, tangent.y, tangent.z, -1};
}

SurfacePoint placed_shape_point(const Affine3d& object_to_world, const Vec3f& point,
                                const Vec3f& normal) {
  const Vec3d p(point), world = transform_point(object_to_world, p);
  SurfacePoint out;
  out.position = Vec3f(world);
  out.normal = normal;
  for (int k = 0; k < 3; ++k) {
    out.tolerance[k] = static_cast<float>(
        kUnitRoundoff *
        (2 * dot(absolute(object_to_world.rows[static_cast<std::size_t>(k)]), absolute(p)) +
         std::fabs(world[k])));
  }
  return out;
}

}  // namespace tessera::render
