#include "worker/shading/tables/sheen.h"

#include <algorithm>
#include <cmath>

#include "worker/shading/microfacet/half_circle.h"

namespace tessera::render {
namespace {

constexpr int kHeights = 64;

/// Albedo by the midpoint rule over the light's azimuth and the root of its cosine.
double albedo(double cos_o, double alpha, const HalfCircle<16>& circle) {
  const double sin_o = std::sqrt((1 - cos_o) * (1 + cos_o));
  const double lambda_o = sheen_lambda(cos_o, alpha);
  double sum = 0;
  for (int i = 0; i < kHeights; ++i) {
    const double t = (i + 0.5) / kHeights, z = t * t;
    const double s = std::sqrt((1 - z) * (1 + z));
    const double share = 2 * t / (4 * cos_o * (1 + lambda_o + sheen_lambda(z, alpha)));
    for (std::size_t k = 0; k < 16; ++k) {
      const double x = sin_o + s * circle.cosine[k], y = s * circle.sine[k], up = cos_o + z;
      const double across = x * x + y * y;
      sum += share * sheen_d(across / (across + up * up), alpha);
    }
  }
  return sum * 6.28318530717958647693 / (kHeights * 16);
}

}  // namespace

SheenTable::SheenTable() {
  const HalfCircle<16> circle;
  for (std::size_t r = 0; r < kRoughness; ++r) {
    const double min_roughness{kMinSheenRoughness};
    const double roughness =
        min_roughness + (1 - min_roughness) * static_cast<double>(r) / (kRoughness - 1);
    for (std::size_t i = 0; i < kCosines; ++i) {
      // A cosine of exactly zero divides by zero; interpolation needs the limit.
      constexpr double kLeastCosine = 1e-5;
      const double x = static_cast<double>(i) / (kCosines - 1);
      const double c = std::max(x * x * x * x, kLeastCosine);
      values_[r][i] = static_cast<float>(albedo(c, roughness * roughness, circle));
    }
  }
}

float SheenTable::at(float cos_theta, float roughness) const {
  const float x = std::sqrt(std::sqrt(clamp(cos_theta, 0.0f, 1.0f))) * (kCosines - 1);
  const float from_min = (roughness - kMinSheenRoughness) / (1 - kMinSheenRoughness);
  const float y = clamp(from_min, 0.0f, 1.0f) * (kRoughness - 1);
  const std::size_t i = x < kCosines - 2 ? static_cast<std::size_t>(x) : kCosines - 2;
  const std::size_t r = y < kRoughness - 2 ? static_cast<std::size_t>(y) : kRoughness - 2;
  const float fx = x - static_cast<float>(i), fy = y - static_cast<float>(r);
  const auto row = [&](std::size_t k) { return lerp(values_[k][i], values_[k][i + 1], fx); };
  return lerp(row(r), row(r + 1), fy);
}

}  // namespace tessera::render
