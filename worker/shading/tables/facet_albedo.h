#pragma once

#include <cstddef>

#include "worker/math/vector.h"
#include "worker/shading/tables/albedo_grid.h"

namespace tessera::render {

/// Directional albedo of single-scattering GGX facets with Schlick's Fresnel term: the fraction
/// f0 a + b of light that leaves without a second bounce between facets. Perfect reflectors have
/// a + b. Tabulated when Tessera is built (make_tables/main.cpp), rounded up: layers below that
/// receive the rest never gain energy. Error at most 1e-3.
struct FacetAlbedo {
  float a = 0, b = 0;
};

/// The tabulated roughness next to that of a lobe.
struct FacetRow {
  const float* nodes = nullptr;  // null: a mirror
  const float* means = nullptr;
  float fraction = 0;  // position between this row and the next
  float alpha = 1;
};

inline constexpr std::size_t kFacetHeights = 96, kFacetRows = 64;

/// `roughness` in [0, 1]; below albedo_grid::kMinRoughness it counts as that.
FacetRow facet_row(float roughness);

/// Cosine-weighted mean of facet_albedo() over the hemisphere; not rounded up.
inline FacetAlbedo mean_facet_albedo(const FacetRow& row) {
  return {lerp(row.means[0], row.means[2], row.fraction),
          lerp(row.means[1], row.means[3], row.fraction)};
}

/// Albedo for light leaving at `cosine` in [0, 1].
inline FacetAlbedo facet_albedo(const FacetRow& row, float cosine) {
  const albedo_grid::Position p =
      albedo_grid::position(albedo_grid::height_of(cosine, row.alpha), kFacetHeights);
  const float *low = row.nodes + 2 * p.index, *high = low + 2 * kFacetHeights;
  return {lerp(lerp(low[0], low[2], p.fraction), lerp(high[0], high[2], p.fraction), row.fraction),
          lerp(lerp(low[1], low[3], p.fraction), lerp(high[1], high[3], p.fraction), row.fraction)};
}

}  // namespace tessera::render
