#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "worker/math/vector.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Environment map in latitude-longitude, bilinear and importance sampled; or a constant radiance.
///
/// u = 0.5 + atan2(d.z, d.x) / 2 pi + rotation / 360, v = acos(d.y) / pi from the top. Refers to
/// the scene, which must outlive it. Negative texels count as black.
class EnvironmentMap {
 public:
  /// Requires scene.has_environment.
  explicit EnvironmentMap(const Scene& scene);

  struct Lookup {
    Vec3f radiance;
    float pdf = 0;  // as pdf()
  };
  /// Radiance and density for direction `d` (unit, world).
  Lookup look_up(const Vec3f& d) const;
  Vec3f radiance(const Vec3f& d) const { return look_up(d).radiance; }

  /// Returns whether it is uniform or black, so that BSDF sampling alone suffices.
  bool is_constant() const { return image_ == nullptr || !(total_ > 0); }

  struct Sample {
    Vec3f direction;  // unit
    Vec3f radiance;
    float pdf = 0;  // over solid angle
  };
  /// Samples a direction with a density proportional to the excess of the filtered luminance over
  /// its mean: chooses a texel, then a point under its bilinear tent. Parts below the mean are left
  /// to BSDF sampling; combine both by MIS. u1 and u2 in [0, 1) with at least 32 bits, so that no
  /// texel falls between two values. Requires !is_constant().
  ///
  /// Source: Karlik et al., "MIS compensation: optimizing sampling techniques in multiple
  /// importance sampling", 2019.
  Sample sample(double u1, double u2) const;

  /// The radiance of a direction, limited to the mean luminance. This part is not in the density of
  /// sample(). Requires !is_constant().
  Vec3f unsampled(const Vec3f& radiance) const;
  /// Share of this part in power(), computed from unfiltered texels. Requires !is_constant().
  double unsampled_share() const { return 1 - excess_power_ / power_; }

  /// Density of sample() at `d`; 0 if no texel around it is brighter than the mean.
  float pdf(const Vec3f& d) const { return look_up(d).pdf; }

  /// A small bright part of the map, such as the sun.
  struct Sun {
    Vec3d towards;                      // unit, centre
    std::array<Vec3d, 3> covariance{};  // of unit directions to it
    double radius = 0;                  // radians
    double radiance = 0;                // mean luminance
  };
  /// The part around the brightest texel, nullopt if that is not 64 times as bright as the mean or
  /// the part is not small.
  std::optional<Sun> sun() const;

  /// Integral of luminance over all directions: flux through a disc of unit area.
  double power() const;

  std::int64_t memory_bytes() const;

 private:
  Vec3f fetch(std::int32_t x, std::int32_t y) const;
  Vec3d towards(double x, double y) const;
  float excess(const Vec3f& texel) const { return std::max(luminance(texel) - mean_, 0.0f); }
  void build();

  const Image* image_ = nullptr;
  Vec3f constant_;
  float strength_ = 1;
  double turn_ = 0;  // rotation in turns
  std::int32_t width_ = 0, height_ = 0;
  std::vector<float> row_sines_;  // sine of the polar angle at each row's centre
  std::vector<double> row_cdf_;   // height + 1, from 0 to 1
  std::vector<double> cdf_;       // [row][width + 1], from 0 to 1 in each row
  float mean_ = 0;                // mean luminance over the sphere
  float density_scale_ = 0;       // from excess times sine per texel to density over solid angle
  double total_ = 0;              // sum of excess times row sine
  double power_ = 0;              // integral of luminance over the sphere, before strength
  double excess_power_ = 0;       // the same for the excess over the mean
};

}  // namespace tessera::render
