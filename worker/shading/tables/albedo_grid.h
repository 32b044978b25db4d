#pragma once

#include <cmath>
#include <cstddef>
#include <span>

#include "worker/math/vector.h"
#include "worker/shading/microfacet/microfacet.h"

/// Coordinates of the tables of albedos over cosine and roughness.
namespace tessera::render::albedo_grid {

/// Smallest tabulated roughness; below, a lobe is a mirror. The square root of kMirrorAlpha.
inline constexpr double kMinRoughness = 0.0316227766016837933;

/// Coordinate of a cosine in [0, 1] for facets of `alpha`, in [0, 1]. Albedos bend at cosines near
/// alpha, which may be tiny, and follow Fresnel's term above: the first part resolves the bend, the
/// second the rest.
template <typename T>
inline T height_of(T cosine, T alpha) {
  return T(0.35) * (cosine * (1 + alpha) / (cosine + alpha)) + T(0.65) * std::sqrt(cosine);
}

/// Inverse of height_of(), for building tables. At least 1e-6: in the plane itself, no normals are
/// visible, and interpolation needs the limit.
inline double cosine_of(double height, double alpha) {
  double low = 1e-6, high = 1;
  for (int i = 0; i < 50; ++i) {
    const double middle = 0.5 * (low + high);
    (height_of(middle, alpha) < height ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// Coordinate of a roughness, in [0, 1]: nodes are densest near mirrors.
template <typename T>
inline T fineness_of(T roughness) {
  constexpr auto kLeast = static_cast<T>(kMinRoughness);
  return std::sqrt(clamp((roughness - kLeast) / (1 - kLeast), T(0), T(1)));
}

/// Inverse of fineness_of().
inline double roughness_of(double fineness) {
  return kMinRoughness + (1 - kMinRoughness) * (fineness * fineness);
}

/// Position of `x` in [0, 1] among `count` equally spaced nodes.
struct Position {
  std::size_t index;  // of the node below; there is always one above
  float fraction;
};
inline Position position(float x, std::size_t count) {
  const auto last = static_cast<float>(count - 1);
  const float scaled = clamp(x, 0.0f, 1.0f) * last;
  const auto i = scaled < last - 1 ? static_cast<std::size_t>(scaled) : count - 2;
  return {i, scaled - static_cast<float>(i)};
}

inline double node(std::size_t i, std::size_t count) {
  return static_cast<double>(i) / static_cast<double>(count - 1);
}

/// Adds to `bound` the error that linear interpolation of `values` along one axis may have below
/// the function (or above it, if not `below`), from the second difference where the function is
/// concave. The axis has `count` nodes `stride` apart.
inline void add_interpolation_error(std::span<const double> values, std::size_t count,
                                    std::size_t stride, bool below, double safety,
                                    std::span<double> bound) {
  const auto bend = [&](std::size_t at) {
    const double second = values[at - stride] - 2 * values[at] + values[at + stride];
    const double error = below ? -second : second;
    return error > 0 ? error : 0;
  };
  for (std::size_t at = 0; at < values.size(); ++at) {
    const std::size_t i = at / stride % count;
    double most = 0;
    for (std::size_t j = i == 0 ? 1 : i - 1; j <= i + 1; ++j) {
      if (j < 1 || j + 1 >= count) continue;
      const double error = bend(at + j * stride - i * stride);
      if (error > most) most = error;
    }
    // An eighth for a parabola; `safety` is for higher terms. Those are largest near the first and
    // last node.
    bound[at] += (i < 2 || i + 2 >= count ? 0.25 : 0.125) * safety * most;
  }
}

}  // namespace tessera::render::albedo_grid
