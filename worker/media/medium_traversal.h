#pragma once

#include "worker/math/elementary.h"
#include "worker/math/vector.h"
#include "worker/media/media.h"
#include "worker/shading/surface/surface.h"

namespace tessera::render {

/// How far a path gets through even media after an event, until it collides.
///
/// The optical depth to go is drawn once, for one channel, and used up stretch by stretch, so that
/// surfaces that are passed change nothing. The other channels are weighed as if any of the three
/// might have been drawn (balance heuristic), which bounds the weights.
/// Source: PBR 4e, section 14.1.2; A. Wilkie et al., "Hero wavelength spectral sampling", 2014.
class MediumTraversal {
 public:
  /// What was drawn no longer holds: there was an event.
  void restart() { begun_ = false; }

  /// Draws, unless that has been done since the last event. `u1` in (0, 1), `u2` in [0, 1).
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

  /// Whether the path collides on a stretch of even medium, and how many metres from the ray's
  /// origin; `throughput` is what arrives there, or at the end, over the probability.
  /// Requires begin().
  bool collides(const MediumSegment& stretch, Vec3f* throughput, double* at) {
    const MediumView& medium = *stretch.medium;
    const double length = stretch.length();
    const auto sigma = static_cast<double>(medium.extinction[channel_]);
    if (sigma > 0 && depth_ < sigma * length) {
      const double way = depth_ / sigma;
      *at = stretch.begin + way;
      const Vec3f arrives = beer_transmittance(medium.extinction, static_cast<float>(way));
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

  /// Density a metre of colliding after `distance` metres; in an uneven medium, as if it were even.
  /// Requires begin().
  float density(const MediumView& medium, double distance) const {
    const Vec3f extinction = medium.extinction * medium.usual;
    const Vec3f arrives = beer_transmittance(extinction, static_cast<float>(distance));
    return dot(share_, extinction * arrives);
  }

 private:
  bool begun_ = false;
  int channel_ = 0;
  double depth_ = 0;         // optical, to go
  Vec3f share_ = {1, 0, 0};  // probability that each channel was drawn, given what was passed
};

}  // namespace tessera::render
