#include "worker/light/emitters/shape_light.h"

#include <cmath>

#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/light/emitters/spherical_triangle.h"
#include "worker/math/elementary.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// 1 - cos of the half angle of the cone around a sphere; 2 if the point is inside it.
double cone_height(double distance, double radius) {
  if (!(distance > radius)) return 2;
  const double sine = radius / distance;
  const double cosine = std::sqrt((1 - sine) * (1 + sine));
  return sine * sine / (1 + cosine);
}

/// Two unit vectors that complete an orthonormal frame.
void span_plane(const Vec3d& axis, Vec3d& s, Vec3d& t) {
  s = normalize(cross(axis, std::fabs(axis.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0}));
  t = cross(axis, s);
}

/// Upper bound of the factor by which a transform scales any vector. For a uniform scale, up to
/// rounding of the rotation, m m' = s^2 (1 + e) with entries of e up to kSame, so the factor is at
/// most s sqrt(1 + 3 kSame); otherwise the Frobenius norm, up to sqrt(3) times too large.
double max_scale(const Affine3d& m) {
  constexpr double kSame = 1e-6;
  const auto& [x, y, z] = m.rows;
  const double xx = dot(x, x), yy = dot(y, y), zz = dot(z, z);
  const bool uniform = std::fabs(xx - yy) <= kSame * xx && std::fabs(xx - zz) <= kSame * xx &&
                       std::fabs(dot(x, y)) <= kSame * xx && std::fabs(dot(y, z)) <= kSame * xx &&
                       std::fabs(dot(z, x)) <= kSame * xx;
  return std::sqrt(uniform ? xx * (1 + 3 * kSame) : xx + yy + zz);
}

/// Radius of the bounding sphere around the centre of the shape's box.
double object_radius(const Shape& shape) {
  const Vec3d half = (Vec3d(shape.bounds.hi) - Vec3d(shape.bounds.lo)) * 0.5;
  // An ellipsoid is bounded by its largest radius, which is exact for a sphere.
  return shape.latitudes ? max_component(half) : length(half);
}

/// Returns whether cross-sections along an axis lie in the ellipses inscribed in the box.
bool is_round(const Shape& shape, int axis) {
  const bool uncut = shape.form == Shape::Form::quadric && std::isinf(shape.clip.hi.x);
  return shape.latitudes || (axis == 1 && (shape.form == Shape::Form::torus || uncut));
}

/// Maximum length of a s + b t over the unit circle, or over the square [-1, 1]^2.
double reach(const Vec3d& a, const Vec3d& b, bool circle) {
  const double aa = dot(a, a), bb = dot(b, b), ab = std::fabs(dot(a, b));
  if (!circle) return std::sqrt(aa + bb + 2 * ab);
  const double half = 0.5 * (aa - bb);
  return std::sqrt(0.5 * (aa + bb) + std::sqrt(half * half + ab * ab));
}

}  // namespace

ShapeLight::ShapeLight(const Affine3d& object_to_world, const Affine3d& world_to_object,
                       const Shape& shape)
    : object_to_world_(object_to_world), world_to_object_(world_to_object), shape_(shape) {
  const Vec3d lo(shape.bounds.lo), hi(shape.bounds.hi);
  centre_ = transform_point(object_to_world_, (lo + hi) * 0.5);
  const int flat = shape.flat_axis();
  if (flat >= 0) {
    enclose_flat(flat);
    return;
  }
  radius_ = object_radius(shape) * max_scale(object_to_world_) * (1 + 0x1p-40);
  std::array<Vec3d, 3> half;
  for (int k = 0; k < 3; ++k) {
    Vec3d edge;
    edge[k] = (hi[k] - lo[k]) * 0.5;
    half[static_cast<std::size_t>(k)] = transform_vector(object_to_world_, edge);
  }
  enclose_long(half);
}

void ShapeLight::enclose_flat(int flat_axis) {
  const Vec3d lo(shape_.bounds.lo), hi(shape_.bounds.hi);
  corner_ = transform_point(object_to_world_, lo);
  Vec3d u, v;
  const int first = (flat_axis + 1) % 3, second = (flat_axis + 2) % 3;
  u[first] = hi[first] - lo[first];
  v[second] = hi[second] - lo[second];
  edge_u_ = transform_vector(object_to_world_, u);
  edge_v_ = transform_vector(object_to_world_, v);
}

/// `half`: half edges of the box in the world.
void ShapeLight::enclose_long(const std::array<Vec3d, 3>& half) {
  std::size_t longest = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (dot(half[k], half[k]) > dot(half[longest], half[longest])) longest = k;
  }
  const Vec3d axis = normalize(half[longest]);
  const Vec3d &a = half[(longest + 1) % 3], &b = half[(longest + 2) % 3];
  const double a_along = dot(a, axis), b_along = dot(b, axis);  // 0 unless sheared
  Column around;
  around.axis = axis;
  around.radius =
      reach(a - axis * a_along, b - axis * b_along, is_round(shape_, static_cast<int>(longest))) *
      (1 + 0x1p-40);
  around.half_length =
      (length(half[longest]) + std::fabs(a_along) + std::fabs(b_along)) * (1 + 0x1p-40);
  if (around.half_length >= 2 * around.radius) column_ = around;
}

Box3d ShapeLight::world_box() const {
  Box3d box;
  for (int corner = 0; corner < 8; ++corner) {
    const Box3f& b = shape_.bounds;
    box.extend(transform_point(
        object_to_world_,
        Vec3d(Vec3f{(corner & 1) != 0 ? b.hi.x : b.lo.x, (corner & 2) != 0 ? b.hi.y : b.lo.y,
                    (corner & 4) != 0 ? b.hi.z : b.lo.z})));
  }
  return box;
}

LightBounds ShapeLight::bounds(double radiance, bool both_sides) const {
  LightBounds light;
  const Box3d box = world_box();
  light.box_min = box.lo;
  light.box_max = box.hi;
  light.emission_angle = kPi / 2;
  const int flat = shape_.flat_axis();
  if (flat < 0) {
    light.normal_angle = kPi;
    // Mean projected area of the proxy over all directions: a quarter of its surface.
    light.strength =
        radiance * kPi *
        (column_.radius > 0 ? column_.radius * (column_.half_length + 0.5 * column_.radius)
                            : radius_ * radius_);
    return light;
  }
  Vec3d axis;
  axis[flat] = 1;
  light.axis = normalize(transform_normal(world_to_object_, axis));
  light.both_sides = both_sides;
  light.strength = radiance * length(cross(edge_u_, edge_v_));
  return light;
}

namespace {

/// A rectangle seen from a point, as two triangles.
struct SeenRectangle {
  SphericalTriangle first, second;
  double solid_angle() const { return first.solid_angle + second.solid_angle; }
};

SeenRectangle see(const Vec3d& corner, const Vec3d& u, const Vec3d& v) {
  return {SphericalTriangle::seen_from_origin(corner, corner + u, corner + u + v),
          SphericalTriangle::seen_from_origin(corner, corner + u + v, corner + v)};
}

}  // namespace

double ShapeLight::solid_angle(const Vec3d& from) const {
  if (!(radius_ > 0)) return see(corner_ - from, edge_u_, edge_v_).solid_angle();
  if (const SphericalStrip seen = strip(from); seen.usable()) return seen.solid_angle();
  return 2 * kPi * cone_height(length(centre_ - from), radius_);
}

Vec3d ShapeLight::sample(const Vec3d& from, double u1, double u2) const {
  if (!(radius_ > 0)) {
    const SeenRectangle seen = see(corner_ - from, edge_u_, edge_v_);
    const double u = u1 * seen.solid_angle();
    return u < seen.first.solid_angle
               ? seen.first.sample(u / seen.first.solid_angle, u2)
               : seen.second.sample(clamp((u - seen.first.solid_angle) / seen.second.solid_angle,
                                          0.0, 1 - 0x1p-53),
                                    u2);
  }
  if (const SphericalStrip seen = strip(from); seen.usable()) return seen.sample(u1, u2);
  const Vec3d to = centre_ - from;
  const double distance = length(to);
  const Vec3d axis = distance > 0 ? to / distance : Vec3d{0, 1, 0};
  const double height = u1 * cone_height(distance, radius_);  // 1 - cos
  const double sine = std::sqrt(height * (2 - height));
  const elementary::SinCosd around = elementary::sincos(2 * kPi * u2);
  Vec3d s, t;
  span_plane(axis, s, t);
  return axis * (1 - height) + (s * around.cos + t * around.sin) * sine;
}

/// All intersections with the line, by ascending t; valid until the thread's next call.
std::span<const ShapeHit> ShapeLight::hits_along(const Vec3d& from, const Vec3d& direction) const {
  thread_local std::vector<ShapeHit> hits;
  hits.clear();
  intersect_shape(shape_, transform_point(world_to_object_, from),
                  transform_vector(world_to_object_, direction), hits);
  return hits;
}

std::optional<ShapeLight::Chord> ShapeLight::chord(const Vec3d& from,
                                                   const Vec3d& direction) const {
  const std::span<const ShapeHit> hits = hits_along(from, direction);
  if (hits.empty() || !(hits.back().t > 0)) return std::nullopt;
  const double first = hits.size() > 1 ? hits.front().t : 0;
  const Chord chord{first > 0 ? first : 0, hits.back().t};
  if (!(chord.begin < chord.end)) return std::nullopt;
  return chord;
}

bool ShapeLight::find(const Vec3d& from, const Vec3d& direction, ShapeHit& hit) const {
  const ShapeHit* best = nullptr;
  for (const ShapeHit& each : hits_along(from, direction)) {
    if (each.t > 0 && (best == nullptr || each.t < best->t)) best = &each;
  }
  if (best != nullptr) hit = *best;
  return best != nullptr;
}

}  // namespace tessera::render
