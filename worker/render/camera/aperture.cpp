#include "worker/render/camera/aperture.h"

#include <algorithm>
#include <cmath>

#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846, kTwoPi = 2 * kPi;

}  // namespace

AperturePoint aperture_point(const Lens& lens, Vec2f u) {
  if (lens.blades == 0) {
    const Vec2f d = warp::disk(u);
    return {d.x * lens.radius, d.y * lens.radius};
  }
  // Chooses the triangle from the centre to a side, then reuses the remainder of u.x within it.
  const float scaled = u.x * static_cast<float>(lens.blades);
  const std::int32_t last = lens.blades - 1;
  const std::int32_t side =
      scaled < static_cast<float>(last) ? static_cast<std::int32_t>(scaled) : last;
  const float rest = scaled - static_cast<float>(side);
  const Vec2f b = warp::uniform_triangle({rest < 1 ? rest : 0x1.fffffep-1f, u.y});
  const double step = kTwoPi / lens.blades;
  const auto first = elementary::sincos(lens.blade_rotation + side * step);
  const auto second = elementary::sincos(lens.blade_rotation + (side + 1) * step);
  return {(b.x * first.cos + b.y * second.cos) * lens.radius,
          (b.x * first.sin + b.y * second.sin) * lens.radius};
}

double aperture_area(const Lens& lens) {
  const double square = lens.radius * lens.radius;
  if (lens.blades == 0) return kPi * square;
  return 0.5 * lens.blades * square * elementary::sin(kTwoPi / lens.blades);
}

bool is_in_aperture(const Lens& lens, const AperturePoint& point) {
  const double square = point.x * point.x + point.y * point.y;
  if (square > lens.radius * lens.radius) return false;
  // Inside of every side: its distance from the centre is that of its middle.
  const double inner = lens.radius * elementary::cos(kPi / std::max(lens.blades, 1));
  for (std::int32_t side = 0; side < lens.blades; ++side) {
    const auto middle =
        elementary::sincos(lens.blade_rotation + (side + 0.5) * kTwoPi / lens.blades);
    if (point.x * middle.cos + point.y * middle.sin > inner) return false;
  }
  return true;
}

}  // namespace tessera::render
