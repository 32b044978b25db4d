#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "worker/math/elementary.h"
#include "worker/math/vector.h"
#include "worker/shading/microfacet/microfacet.h"

namespace tessera::render {

/// Points over the visible normals of GGX facets: a Fibonacci lattice of sample_visible_normal()'s
/// arguments. Uses operations only that have the same bits on every machine, for tables that must
/// be identical everywhere. `count` is a multiple of 8.
///
/// The integrands have kinks where scattered light reaches the horizon; there a lattice converges
/// faster than a product rule. The largest error of an albedo is 5e-4 with 512 points, 2e-4 with
/// 1024.
struct VisibleNormals {
  std::vector<double> cosine, sine, u, weight;  // the weights of all points add up to 1

  explicit VisibleNormals(std::size_t count) {
    constexpr double kGolden = 0.61803398874989484820, kTau = 6.28318530717958647693;
    double phase = 0;
    for (std::size_t i = 0; i < count; ++i) {
      // u = 1 - v^2 puts more points into the long tail of the lobe, where smooth lobes lose
      // energy.
      const double v = (static_cast<double>(i) + 0.5) / static_cast<double>(count);
      const elementary::SinCosd angle = elementary::sincos(kTau * phase);
      cosine.push_back(angle.cos);
      sine.push_back(angle.sin);
      u.push_back(1 - v * v);
      weight.push_back(2 * v / static_cast<double>(count));
      phase += kGolden;
      if (phase >= 1) phase -= 1;
    }
  }
};

/// Masking of light scattered by a facet into a direction of cosine `c` > 0: G2 / G1(wo).
inline double scattered_share(double cos_o, double root_o, double c, double root_i) {
  return 2 * c * (cos_o + root_o) * smith_visibility(cos_o, c, root_o, root_i);
}

/// Directional albedo of facets with a Fresnel term f0 + (1 - f0) s, which is linear in f0:
/// f0 a + b, with a the mean of 1 - s and b that of s. Perfect reflectors have a + b.
struct SchlickAlbedo {
  double a = 0, b = 0;
};

/// Albedo for light leaving along `wo` (unit; alpha `at` along x, `ab` along y) with Schlick's
/// s = (1 - cos)^5.
inline SchlickAlbedo schlick_albedo(const VisibleNormals& normals, const Vec3d& wo, double at,
                                    double ab) {
  constexpr std::size_t kLanes = 8;
  const double root_o = smith_root(wo, at, ab);
  SchlickAlbedo sum;
  for (std::size_t first = 0; first < normals.u.size(); first += kLanes) {
    std::array<double, kLanes> all{}, grazing{};
    for (std::size_t k = 0; k < kLanes; ++k) {
      const std::size_t i = first + k;
      const Vec3d h =
          sample_visible_normal(wo, at, ab, normals.cosine[i], normals.sine[i], normals.u[i]);
      const double c = dot(wo, h);
      const Vec3d wi = h * (2 * c) - wo;
      const double z = wi.z > 0 ? wi.z : 0;
      const double m = 1 - c, m2 = m * m;
      all[k] = normals.weight[i] * scattered_share(wo.z, root_o, z, smith_root(wi, at, ab));
      grazing[k] = all[k] * (m2 * m2 * m);
    }
    for (std::size_t k = 0; k < kLanes; ++k) {
      sum.a += all[k] - grazing[k];
      sum.b += grazing[k];
    }
  }
  return sum;
}

}  // namespace tessera::render
