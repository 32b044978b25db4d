#include "worker/accel/solids/crossing_bounds.h"

#include <algorithm>
#include <cmath>

#include "worker/geometry/shapes/shape_surface.h"

namespace tessera::render {
namespace {

constexpr double kOperandError = kOperandRoundings * 0x1p-53;
constexpr double kVertexError = kVertexRoundings * 0x1p-24;

/// At a tangent the error of t grows to the square root of the rounding error, in lengths of the
/// shape: sqrt(256 * 2^-53) < 2^-22.
constexpr double kTangentError = 0x1p-22;

double sum(const Vec3d& v) {
  return v.x + v.y + v.z;
}

/// Bounds the rounding errors of the distance along `normal` between the surface and the point at
/// t: they are proportional to the sum of the absolute values of the terms of both.
double distance_rounding(const OperandLine& line, const Vec3d& normal, const Vec3d& point,
                         double t) {
  const Vec3d world = absolute(Vec3d(line.ray.origin)) + absolute(line.recentring) +
                      absolute(Vec3d(line.ray.direction)) * std::fabs(t);
  const auto& rows = line.world_to_object.rows;
  const Vec3d object = {dot(absolute(rows[0]), world), dot(absolute(rows[1]), world),
                        dot(absolute(rows[2]), world)};
  return kOperandError * dot(absolute(normal),
                             object + absolute(line.world_to_object.translation) + absolute(point));
}

/// The smaller of both; `limit` if x is NaN.
double at_most(double x, double limit) {
  return x < limit ? x : limit;
}

}  // namespace

CrossingBounds shape_crossing(const OperandLine& line, const Shape& shape, const ShapeHit& hit) {
  const Vec3d normal = shape_normal(shape, hit.face, hit.point);
  const double error =
      distance_rounding(line, normal, hit.point, hit.t) / std::fabs(dot(normal, line.direction));
  const double length =
      sum(Vec3d(shape.bounds.hi) - Vec3d(shape.bounds.lo)) / max_abs(line.direction);
  const double bound = at_most(error, kTangentError * length);
  return {hit.t, bound, bound};
}

CrossingBounds triangle_crossing(const OperandLine& line, const Vec3d& v0, const Vec3d& v1,
                                 const Vec3d& v2) {
  const Vec3d& d = line.direction;
  const double length2 = dot(d, d);
  const double t0 = dot(v0 - line.origin, d), t1 = dot(v1 - line.origin, d),
               t2 = dot(v2 - line.origin, d);
  const double low = std::min({t0, t1, t2}) / length2, high = std::max({t0, t1, t2}) / length2;
  const Vec3d normal = cross(v1 - v0, v2 - v0);
  const double incidence = dot(normal, d);
  CrossingBounds out;
  out.t = dot(normal, v0 - line.origin) / incidence;
  if (!(out.t >= low)) out.t = low;
  if (out.t > high) out.t = high;
  const double vertex = kVertexError * std::max({max_abs(v0), max_abs(v1), max_abs(v2)});
  const double across = 1 / std::fabs(incidence), along = 1 / length2;
  const auto bound = [&](double plane, double axis) {
    return at_most(plane * across, high - low + axis * along);
  };
  const double plane_rounding = distance_rounding(line, normal, v0, out.t);
  const double axis_rounding = distance_rounding(line, d, v0, out.t);
  out.rounding = bound(plane_rounding, axis_rounding);
  out.error = bound(plane_rounding + vertex * sum(absolute(normal)),
                    axis_rounding + vertex * sum(absolute(d)));
  return out;
}

}  // namespace tessera::render
