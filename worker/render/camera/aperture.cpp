#include "worker/render/camera/aperture.h"

#include "worker/math/elementary.h"
#include "worker/sampling/warp.h"

namespace tessera::render {

AperturePoint aperture_point(const Lens& lens, Vec2f u) {
  if (lens.blades == 0) {
    const Vec2f d = warp::disk(u);
    return {d.x * lens.radius, d.y * lens.radius};
  }
  // Chooses the triangle from the centre to a side, then reuses the remainder of u.x within it.
  constexpr double kTwoPi = 6.28318530717958647692;
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

}  // namespace tessera::render
