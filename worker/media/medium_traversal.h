#pragma once

#include "worker/math/elementary.h"
#include "worker/math/vector.h"
#include "worker/media/media.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// Free-flight sampling in homogeneous media.
///
/// The optical depth to the next collision is drawn once, for one channel, and consumed segment by
/// segment, so crossing an invisible surface changes nothing. The other channels are weighted by
/// the balance heuristic over all three, which bounds the weights.
/// Source: PBR 4e, section 14.1.2; A. Wilkie et al., "Hero wavelength spectral sampling", 2014.
class MediumTraversal {
 public:
  /// Forgets the drawn depth after a scattering event.
  void restart() { begun_ = false; }

  /// Draws an optical depth unless one is left since the last event. `u1` in (0, 1), `u2` in [0,
  /// 1).
  void begin(double u1, double u2, const Vec3f& throughput) {
    if (begun_) return;
    begun_ = true;
    depth_ = -elementary::log(u1);
    const Vec3f w = max(throughput, Vec3f{});
    const float sum = w.x + w.y + w.z;
    share_ = sum > 0 ? w / sum : Vec3f{1, 0, 0};
    const auto u = static_cast<float>(u2);
    channel_ = u < share_.x ? 0 : u < share_.x + share_.y ? 1 : 2;
    if (!(share_[channel_] > 0)) channel_ = share_.y > 0 ? 1 : 0;  // rounding of the sums
  }

  /// Returns whether the path collides on a segment of homogeneous medium, and the distance from
  /// the ray's origin; multiplies `throughput` by the transmittance to there, or to the end, over
  /// the probability. Requires begin().
  bool collides(const MediumSegment& segment, Vec3f* throughput, double* at) {
    const MediumView& medium = *segment.medium;
    const double length = segment.length();
    const auto sigma = static_cast<double>(medium.extinction[channel_]);
    if (sigma > 0 && depth_ < sigma * length) {
      const double travelled = depth_ / sigma;
      *at = segment.begin + travelled;
      const Vec3f arrives = beer_transmittance(medium.extinction, static_cast<float>(travelled));
      *throughput *= medium.scattering * arrives / dot(share_, medium.extinction * arrives);
      return true;
    }
    const Vec3f arrives = beer_transmittance(medium.extinction, static_cast<float>(length));
    const float probability = dot(share_, arrives);
    *throughput *= arrives / probability;
    share_ *= arrives / probability;
    if (sigma > 0) depth_ -= sigma * length;
    return false;
  }

  /// Density per metre of a collision after `distance` metres; for a heterogeneous medium, as if it
  /// had its typical density everywhere. Requires begin().
  float density(const MediumView& medium, double distance) const {
    const Vec3f extinction = medium.extinction * medium.typical_density;
    const Vec3f arrives = beer_transmittance(extinction, static_cast<float>(distance));
    return dot(share_, extinction * arrives);
  }

 private:
  bool begun_ = false;
  int channel_ = 0;
  double depth_ = 0;         // remaining optical depth
  Vec3f share_ = {1, 0, 0};  // probability that each channel was drawn, given the distance so far
};

}  // namespace tessera::render
