#include "worker/shading/tables/anisotropic_albedo.h"

#include <algorithm>
#include <array>

#include "anisotropic_albedo.inc"

namespace tessera::render {

AnisotropicAlbedo::AnisotropicAlbedo(float roughness, float strength)
    : alpha_b_(std::max(roughness * roughness, kMirrorAlpha)) {
  alpha_t_ = anisotropic_alpha(alpha_b_, strength);
  fine_b_ = albedo_grid::fineness_of(std::sqrt(alpha_b_));
  fine_t_ = albedo_grid::fineness_of(std::sqrt(alpha_t_));
  const albedo_grid::Position s =
      albedo_grid::position(fine_b_ < 1 ? (fine_t_ - fine_b_) / (1 - fine_b_) : 0, kAlphas);
  const albedo_grid::Position r = albedo_grid::position(fine_b_, kRows);
  first_ = s.index * kRows + r.index;
  along_ = s.fraction;
  row_ = r.fraction;
}

FacetAlbedo AnisotropicAlbedo::at(const Vec3f& w) const {
  const float x2 = w.x * w.x, y2 = w.y * w.y, across = x2 + y2;
  const float along = across > 0 ? x2 / across : 0;
  const float alpha = std::sqrt(lerp(alpha_b_ * alpha_b_, alpha_t_ * alpha_t_, along));
  const float width = fine_t_ - fine_b_;
  const float fine = albedo_grid::fineness_of(std::sqrt(alpha)) - fine_b_;
  const albedo_grid::Position k = albedo_grid::position(width > 0 ? fine / width : 0, kPlanes);
  const albedo_grid::Position i = albedo_grid::position(
      albedo_grid::height_of(clamp(std::fabs(w.z), 0.0f, 1.0f), alpha), kHeights);
  const auto line = [&](std::size_t row, std::size_t plane) -> FacetAlbedo {
    const float* n = &kAnisotropicNodes[2 * ((row * kPlanes + plane) * kHeights + i.index)];
    return {lerp(n[0], n[2], i.fraction), lerp(n[1], n[3], i.fraction)};
  };
  const auto blend = [](const FacetAlbedo& p, const FacetAlbedo& q, float f) -> FacetAlbedo {
    return {lerp(p.a, q.a, f), lerp(p.b, q.b, f)};
  };
  const auto lobe = [&](std::size_t row) {
    return blend(line(row, k.index), line(row, k.index + 1), k.fraction);
  };
  return blend(blend(lobe(first_), lobe(first_ + 1), row_),
               blend(lobe(first_ + kRows), lobe(first_ + kRows + 1), row_), along_);
}

FacetAlbedo AnisotropicAlbedo::mean() const {
  const auto entry = [&](std::size_t at) {
    const float *low = &kAnisotropicMeans[2 * first_ + at], *high = low + 2 * kRows;
    return lerp(lerp(low[0], low[2], row_), lerp(high[0], high[2], row_), along_);
  };
  return {entry(0), entry(1)};
}

}  // namespace tessera::render
