// Intersection of a line with a torus: the real roots of a quartic.

#include <array>
#include <cmath>

#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/polynomial_roots.h"

namespace tessera::render {

/// With the radius R, the tube's radius r and k = R^2 - r^2, the surface is
/// (p.p + k)^2 = 4 R^2 (x^2 + z^2). The constant term is computed as the product
/// ((rho - R)^2 + y^2 - r^2) ((rho + R)^2 + y^2 - r^2), rho^2 = x^2 + z^2, which is accurate near
/// the surface.
void intersect_torus(const Shape& shape, const Vec3d& origin, const Vec3d& direction,
                     std::vector<ShapeHit>& hits) {
  const double outer = shape.radius + shape.tube;
  const double size = length(direction);
  const Vec3d d = direction / size, o = origin;
  const double along = dot(o, d), o2 = dot(o, o);
  // Half of the chord of the bounding sphere, enlarged a little.
  const double half2 = outer * outer * (1 + 0x1p-40) - (o2 - along * along);
  if (!(half2 > 0)) return;
  const double half = std::sqrt(half2) * (1 + 0x1p-20);
  const double r2 = 4 * shape.radius * shape.radius;
  const double k = (shape.radius - shape.tube) * outer;
  const double rho = std::sqrt(o.x * o.x + o.z * o.z), tube2 = shape.tube * shape.tube;
  const double inner = (rho - shape.radius) * (rho - shape.radius) + o.y * o.y - tube2;
  const double beyond = (rho + shape.radius) * (rho + shape.radius) + o.y * o.y - tube2;
  const double m = o2 + k;
  const std::array<double, 5> quartic = {
      inner * beyond, 4 * along * m - 2 * r2 * (o.x * d.x + o.z * d.z),
      4 * along * along + 2 * m - r2 * (d.x * d.x + d.z * d.z), 4 * along, 1};
  std::array<double, 4> roots;
  const int count = real_roots(quartic, -along - half, -along + half, roots);
  for (int i = 0; i < count; ++i) {
    const double t = roots[static_cast<std::size_t>(i)];
    hits.push_back({t / size, o + d * t, kCurvedFace, i % 2 == 0});
  }
}

}  // namespace tessera::render
