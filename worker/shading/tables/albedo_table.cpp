#include "worker/shading/tables/albedo_table.h"

#include <cmath>

#include "worker/math/vector.h"
#include "worker/shading/microfacet/fresnel.h"
#include "worker/shading/microfacet/half_circle.h"
#include "worker/shading/microfacet/microfacet.h"

namespace tessera::render {
namespace {

constexpr int kAzimuths = 8, kElevations = 64;  // midpoint rule over half the visible normals

using Circle = HalfCircle<kAzimuths>;

/// G2 / G1(wo) for a direction of cosine `cos_i` on either side.
double masking_ratio(double cos_o, double cos_i, double root_o, double alpha) {
  const double c = std::fabs(cos_i);
  const double root_i = smith_root(c, alpha);
  return 2 * c * (cos_o + root_o) * smith_visibility(cos_o, c, root_o, root_i);
}

double exact_fresnel(double c, double eta) {
  const double g2 = (eta - 1) * (eta + 1) + c * c;
  if (!(g2 > 0)) return 1;
  const double g = std::sqrt(g2);
  const double a = (eta - 1) * (eta + 1) / ((g + c) * (g + c));
  const double b = (c * (g + c) - 1) / (c * (g - c) + 1);
  return 0.5 * a * a * (1 + b * b);
}

/// Albedo at one grid point; eta 0 means perfectly reflecting facets.
double albedo(double cos_o, double alpha, double eta, const Circle& circle) {
  const Vec3d wo{std::sqrt((1 - cos_o) * (1 + cos_o)), 0, cos_o};
  const double root_o = smith_root(cos_o, alpha);
  double sum = 0;
  for (int e = 0; e < kElevations; ++e) {
    // u = 1 - v^2 concentrates points in the long tail of the lobe, where smooth lobes lose
    // energy.
    const double v = (e + 0.5) / kElevations;
    const double weight = 2 * v;
    for (std::size_t a = 0; a < kAzimuths; ++a) {
      const double u = 1 - v * v;
      const Vec3d h = sample_visible_normal(wo, alpha, circle.cosine[a], circle.sine[a], u);
      const double c = dot(wo, h);
      if (!(c > 0)) continue;
      const double reflected_z = 2 * c * h.z - cos_o;
      const double f = eta > 0 ? exact_fresnel(c, eta) : 1;
      if (reflected_z > 0) sum += weight * f * masking_ratio(cos_o, reflected_z, root_o, alpha);
      const double g2 = (eta - 1) * (eta + 1) + c * c;
      if (!(eta > 0) || !(g2 > 0)) continue;
      const double refracted_z = (h.z * (c - std::sqrt(g2)) - cos_o) / eta;
      if (refracted_z < 0)
        sum += weight * (1 - f) * masking_ratio(cos_o, refracted_z, root_o, alpha);
    }
  }
  return sum / (kElevations * kAzimuths);
}

/// Index of a grid point in values_.
constexpr std::size_t index_of(int roughness, int cosine) {
  return static_cast<std::size_t>(roughness) * AlbedoTable::kCosines +
         static_cast<std::size_t>(cosine);
}

double grid_cosine(int i) {
  const double x = static_cast<double>(i) / (AlbedoTable::kCosines - 1);
  return x * x;
}

}  // namespace

AlbedoTable AlbedoTable::dielectric(double eta) {
  const Circle circle;
  AlbedoTable table;
  for (int r = 0; r < kRoughness; ++r) {
    const double roughness = static_cast<double>(r) / (kRoughness - 1);
    for (int i = 0; i < kCosines; ++i) {
      // A cosine of exactly zero sees no normals; interpolation needs the limit.
      const double c = i == 0 ? 1e-4 : grid_cosine(i);
      const double e = r == 0 ? 1 : albedo(c, roughness * roughness, eta, circle);
      table.values_[index_of(r, i)] = static_cast<float>(clamp(e, 0.0, 1.0));
    }
  }
  table.fill_averages();
  return table;
}

AlbedoTable AlbedoTable::reflector() {
  return dielectric(0);
}

float AlbedoTable::at(float cos_theta, float roughness) const {
  const float x = std::sqrt(clamp(cos_theta, 0.0f, 1.0f)) * (kCosines - 1);
  const float y = clamp(roughness, 0.0f, 1.0f) * (kRoughness - 1);
  const int i = x < kCosines - 2 ? static_cast<int>(x) : kCosines - 2;
  const int r = y < kRoughness - 2 ? static_cast<int>(y) : kRoughness - 2;
  const float* row = &values_[index_of(r, i)];
  const float fx = x - static_cast<float>(i), fy = y - static_cast<float>(r);
  return lerp(lerp(row[0], row[1], fx), lerp(row[kCosines], row[kCosines + 1], fx), fy);
}

float AlbedoTable::average(float roughness) const {
  const float y = clamp(roughness, 0.0f, 1.0f) * (kRoughness - 1);
  const int r = y < kRoughness - 2 ? static_cast<int>(y) : kRoughness - 2;
  const auto k = static_cast<std::size_t>(r);
  return lerp(averages_[k], averages_[k + 1], y - static_cast<float>(r));
}

void AlbedoTable::fill_averages() {
  constexpr int kSteps = 64;  // midpoint rule over the interpolation of at(), so that both agree
  for (int r = 0; r < kRoughness; ++r) {
    double sum = 0;
    for (int k = 0; k < kSteps; ++k) {
      const double c = (k + 0.5) / kSteps;
      sum += 2 * c * at(static_cast<float>(c), static_cast<float>(r) / (kRoughness - 1));
    }
    averages_[static_cast<std::size_t>(r)] = static_cast<float>(sum / kSteps);
  }
}

}  // namespace tessera::render
