#include "worker/shading/tables/sheen.h"

#include <array>

#include "sheen.inc"
#include "worker/shading/tables/albedo_grid.h"

namespace tessera::render {

float sheen_albedo(float cosine, float roughness) {
  const float from_min = (roughness - kMinSheenRoughness) / (1 - kMinSheenRoughness);
  const albedo_grid::Position r = albedo_grid::position(from_min, kSheenRows);
  const albedo_grid::Position c =
      albedo_grid::position(std::sqrt(std::sqrt(clamp(cosine, 0.0f, 1.0f))), kSheenCosines);
  const float *low = &kSheenNodes[r.index * kSheenCosines + c.index], *high = low + kSheenCosines;
  return lerp(lerp(low[0], low[1], c.fraction), lerp(high[0], high[1], c.fraction), r.fraction);
}

}  // namespace tessera::render
