#pragma once

#include "worker/math/elementary.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Distances on an interval with a density that falls as exp(-rate t): proportional to the
/// transmittance of a homogeneous medium. Uniform at a rate of 0, and where the density would vary
/// by less than 2^-20.
class ExponentialDistance {
 public:
  /// Distances are in [begin, end], begin < end. Requires a finite rate of at least 0, above 0 if
  /// `end` is infinite.
  ExponentialDistance(double rate, double begin, double end) : begin_(begin), end_(end) {
    if (!(rate * (end - begin) > 0x1p-20)) return;
    rate_ = rate;
    within_ = 1 - elementary::exp(-rate * (end - begin));
  }

  /// Samples a distance with u in [0, 1).
  double sample(double u) const {
    if (!(rate_ > 0)) return begin_ + u * (end_ - begin_);
    return clamp(begin_ - elementary::log(1 - u * within_) / rate_, begin_, end_);
  }

  /// Density per metre at a distance in the interval.
  double pdf(double t) const {
    if (!(rate_ > 0)) return 1 / (end_ - begin_);
    return rate_ * elementary::exp(-rate_ * (t - begin_)) / within_;
  }

 private:
  double begin_, end_;
  double rate_ = 0;    // 0: uniform
  double within_ = 1;  // probability that an unlimited distance lies in the interval
};

}  // namespace tessera::render
