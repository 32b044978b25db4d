#include "worker/render/transparency.h"

#include <algorithm>
#include <tuple>

#include "worker/shading/surface.h"

namespace tessera::render {
bool ClosestFilter::operator()(const TriangleId& id, float, float b1, float b2) {
  const auto wanted = static_cast<std::uint8_t>(scene.primitive(id).traits & traits);
  if (wanted == 0) return true;
  const SurfacePoint point = surface_at(scene, id, b1, b2, direction);
  if ((wanted & kTraitOneSided) != 0 && !point.front) return false;
  if ((wanted & kTraitUnlit) != 0) return false;
  if ((wanted & kTraitAlpha) == 0) return true;
  if (chance.at(id) < coverage_at(scene, point)) return true;
  ++passed;
  return false;
}

bool ShadowFilter::operator()(const TriangleId& id, float t, float b1, float b2) {
  if (id == target) return false;
  const auto wanted = static_cast<std::uint8_t>(scene.primitive(id).traits & traits);
  if (wanted == 0) return true;
  if ((wanted & kTraitUnlit) != 0) return false;
  const SurfacePoint point = surface_at(scene, id, b1, b2, direction);
  if ((wanted & kTraitAlpha) != 0 && !(chance.at(id) < coverage_at(scene, point))) {
    ++passed;
    return false;
  }
  if ((wanted & kTraitStraight) == 0) return true;
  const Bsdf bsdf = bsdf_at(scene, point, base_color_at(scene, point), -direction);
  const Vec3f share = straight_transmittance(bsdf);
  if (!(max_component(share) > 0)) return true;
  ++passed;
  if (sheet_count < kTransparencyLimit) {
    (*sheets)[static_cast<std::size_t>(sheet_count)] = {t, id, share};
    ++sheet_count;
  }
  return false;
}

Vec3f ShadowFilter::transmittance() {
  const auto end = sheets->begin() + sheet_count;
  std::sort(sheets->begin(), end, [](const Sheet& a, const Sheet& b) {
    return std::tie(a.t, a.id) < std::tie(b.t, b.id);
  });
  Vec3f product{1, 1, 1};
  for (auto sheet = sheets->begin(); sheet != end; ++sheet) product *= sheet->transmittance;
  return product;
}

}  // namespace tessera::render
