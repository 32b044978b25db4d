#include "worker/render/path/transparency.h"

#include <algorithm>
#include <tuple>

#include "worker/shading/surface/surface.h"

namespace tessera::render {
bool ClosestFilter::operator()(const Hit& hit) const {
  const auto relevant = static_cast<std::uint8_t>(scene.primitive(hit.id).traits & traits);
  if (relevant == 0) return true;
  if ((relevant & kTraitUnlit) != 0) return false;
  const ShadingPoint point = surface_at(scene, hit, direction, time, *moved);
  if ((relevant & kTraitOneSided) != 0 && !point.front) return false;
  if ((relevant & kTraitAlpha) == 0) return true;
  if (decisions.random(hit.id) < coverage_at(scene, point)) return true;
  ++*passed;
  return false;
}

bool ShadowFilter::operator()(const Hit& hit) const {
  if (hit.id == target) return false;
  const auto relevant = static_cast<std::uint8_t>(scene.primitive(hit.id).traits & traits);
  if (relevant == 0) return true;
  if ((relevant & kTraitUnlit) != 0) return false;
  const ShadingPoint point = surface_at(scene, hit, direction, time, *moved);
  if ((relevant & kTraitAlpha) != 0 && !(decisions.random(hit.id) < coverage_at(scene, point))) {
    ++stack->passed;
    return false;
  }
  if ((relevant & kTraitStraight) == 0) return true;
  const Bsdf bsdf = bsdf_at(scene, point, base_color_at(scene, point), -direction);
  const Vec3f share = straight_transmittance(bsdf);
  if (!(max_component(share) > 0)) return true;
  ++stack->passed;
  if (stack->count < kTransparencyLimit) {
    stack->surfaces[static_cast<std::size_t>(stack->count)] = {hit.t, hit.id, share};
    ++stack->count;
  }
  return false;
}

Vec3f ThinSurfaceStack::transmittance() {
  const auto end = surfaces.begin() + count;
  std::sort(surfaces.begin(), end, [](const ThinSurface& a, const ThinSurface& b) {
    return std::tie(a.t, a.id) < std::tie(b.t, b.id);
  });
  Vec3f product{1, 1, 1};
  for (auto surface = surfaces.begin(); surface != end; ++surface)
    product *= surface->transmittance;
  return product;
}

}  // namespace tessera::render
