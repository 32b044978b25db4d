#include "worker/shading/tables/anisotropic_albedo.h"

#include <algorithm>
#include <cmath>

#include "worker/shading/microfacet/half_circle.h"
#include "worker/shading/microfacet/microfacet.h"

namespace tessera::render {
namespace {

constexpr int kElevations = 24;  // midpoint rule over the visible normals

struct Alphas {
  double t, b;
};

Alphas alphas_of(double roughness, double strength) {
  const double b = std::max(roughness * roughness, double{kMirrorAlpha});
  return {b + (1 - b) * (strength * strength), b};
}

double albedo(const Vec3d& wo, const Alphas& a, const HalfCircle<8>& circle) {
  const double root_o = smith_root(wo, a.t, a.b);
  double sum = 0;
  for (int e = 0; e < kElevations; ++e) {
    const double v = (e + 0.5) / kElevations, u = 1 - v * v;  // as in albedo_table.cpp
    for (std::size_t k = 0; k < 16; ++k) {
      const double side = k < 8 ? 1 : -1;  // the other half of the circle
      const Vec3d h = sample_visible_normal(wo, a.t, a.b, side * circle.cosine[k % 8],
                                            side * circle.sine[k % 8], u);
      const Vec3d wi = h * (2 * dot(wo, h)) - wo;
      if (!(wi.z > 0)) continue;
      // G2 / G1(wo)
      sum += 2 * v * 2 * wi.z * (wo.z + root_o) *
             smith_visibility(wo.z, wi.z, root_o, smith_root(wi, a.t, a.b));
    }
  }
  return sum / (kElevations * 16);
}

/// Position of `x` in [0, 1] among `count` equally spaced grid points.
struct GridPosition {
  std::size_t index;  // of the point below; there is always one above
  float fraction;
};

GridPosition grid_position(float x, int count) {
  const float scaled = clamp(x, 0.0f, 1.0f) * static_cast<float>(count - 1);
  const int i = scaled < static_cast<float>(count - 2) ? static_cast<int>(scaled) : count - 2;
  return {static_cast<std::size_t>(i), scaled - static_cast<float>(i)};
}

double grid(std::size_t i, int count) {
  return static_cast<double>(i) / (count - 1);
}

}  // namespace

AnisotropicAlbedo::AnisotropicAlbedo() {
  const HalfCircle<8> circle;
  for (std::size_t s = 0; s < kStrengths; ++s) {
    for (std::size_t r = 0; r < kRoughness; ++r) {
      const Alphas a = alphas_of(grid(r, kRoughness), grid(s, kStrengths));
      for (std::size_t i = 0; i < kHeights; ++i) {
        // A viewer in the surface sees no normals; interpolation needs the limit.
        const double g = grid(i, kHeights), z = i == 0 ? 1e-4 : g * g;
        const double across = std::sqrt((1 - z) * (1 + z));
        for (std::size_t k = 0; k < kAzimuths; ++k) {
          const double share = grid(k, kAzimuths);
          const Vec3d wo = normalize(
              Vec3d{across * std::sqrt(share) / a.t, across * std::sqrt(1 - share) / a.b, z});
          values_[s][r][i][k] = static_cast<float>(clamp(albedo(wo, a, circle), 0.0, 1.0));
        }
      }
    }
  }
  fill_averages();
}

float AnisotropicAlbedo::at(const Vec3f& wo, float roughness, float strength) const {
  const float b = std::max(roughness * roughness, kMirrorAlpha);
  const Vec3f w = direction_of(Vec3f{wo.x * anisotropic_alpha(b, strength), wo.y * b, wo.z});
  const float along = w.x * w.x, across = w.x * w.x + w.y * w.y;
  const GridPosition s = grid_position(strength, kStrengths),
                     r = grid_position(roughness, kRoughness);
  const GridPosition i = grid_position(std::sqrt(clamp(w.z, 0.0f, 1.0f)), kHeights);
  const GridPosition k = grid_position(across > 0 ? along / across : 0, kAzimuths);
  const auto line = [&](std::size_t ds, std::size_t dr, std::size_t di) {
    const auto& row = values_[s.index + ds][r.index + dr][i.index + di];
    return lerp(row[k.index], row[k.index + 1], k.fraction);
  };
  const auto plane = [&](std::size_t ds, std::size_t dr) {
    return lerp(line(ds, dr, 0), line(ds, dr, 1), i.fraction);
  };
  return lerp(lerp(plane(0, 0), plane(0, 1), r.fraction),
              lerp(plane(1, 0), plane(1, 1), r.fraction), s.fraction);
}

float AnisotropicAlbedo::average(float roughness, float strength) const {
  const GridPosition s = grid_position(strength, kStrengths),
                     r = grid_position(roughness, kRoughness);
  const auto row = [&](const std::array<float, kRoughness>& a) {
    return lerp(a[r.index], a[r.index + 1], r.fraction);
  };
  return lerp(row(averages_[s.index]), row(averages_[s.index + 1]), s.fraction);
}

void AnisotropicAlbedo::fill_averages() {
  constexpr int kSteps = 32;  // midpoint rule over the interpolation of at(), so that both agree
  const HalfCircle<8> circle;
  for (std::size_t s = 0; s < kStrengths; ++s) {
    for (std::size_t r = 0; r < kRoughness; ++r) {
      double sum = 0;
      for (int i = 0; i < kSteps; ++i) {
        const double z = (i + 0.5) / kSteps, across = std::sqrt((1 - z) * (1 + z));
        for (std::size_t k = 0; k < 8; ++k) {
          const Vec3f wo(Vec3d{across * circle.cosine[k], across * circle.sine[k], z});
          sum += 2 * z *
                 static_cast<double>(at(wo, static_cast<float>(grid(r, kRoughness)),
                                        static_cast<float>(grid(s, kStrengths))));
        }
      }
      averages_[s][r] = static_cast<float>(sum / (kSteps * 8));
    }
  }
}

}  // namespace tessera::render
