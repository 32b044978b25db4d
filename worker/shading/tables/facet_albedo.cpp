#include "worker/shading/tables/facet_albedo.h"

#include <array>

#include "facet_albedo.inc"

namespace tessera::render {

FacetRow facet_row(float roughness) {
  const albedo_grid::Position p =
      albedo_grid::position(albedo_grid::fineness_of(roughness), kFacetRows);
  constexpr auto kLeast = static_cast<float>(albedo_grid::kMinRoughness);
  const float r = clamp(roughness, kLeast, 1.0f);
  return {&kFacetNodes[p.index * 2 * kFacetHeights], &kFacetMeans[2 * p.index], p.fraction, r * r};
}

}  // namespace tessera::render
