#pragma once

namespace tessera::image {

/// Constants of the filter, in units of the frame's mean luminance where they are radiances. Tuned
/// on the scenes of tests/bench/coverage.
struct FilterParameters {
  static constexpr int kWindowRadius = 5, kRegressionRadius = 3;
  static constexpr float kGuideNoise = 1, kFilterNoise = 4;  // squared multiples of the noise
  static constexpr float kGuideTolerance = 1e-4f, kFilterTolerance = 1e-3f;  // of squared colour
  static constexpr float kMinSquare = 1e-9f;
  /// A pixel adds at most 1 to the distance of two patches of 3 x 3 pixels, so that a patch whose
  /// centre has met a rare path in both streams is still averaged. Not where the squared difference
  /// of the colours exceeds kMaxContrast times the square of the darker one, as beside a small
  /// lamp.
  static constexpr float kMaxRatio = 9, kMaxContrast = 16;
  static constexpr float kAlbedoSquare = 0.01f, kNormalSquare = 0.05f, kDepthSquare = 0.01f;
  static constexpr float kSpikeFactor = 2, kMaxSpikes = 2;  // spike_limit.h
  /// Scales of the regression's features: 1/√0.1 for albedo and hits, 1/√0.3 for normals, and
  /// 1/(0.2 z) for depth.
  static constexpr float kAlbedoScale = 3.1622777f, kNormalScale = 1.8257419f, kDepthScale = 5;
  static constexpr float kRidge = 0.1f, kMinPivot = 1e-6f;
  /// Fraction of the raw image's variance that is added to the estimated error of a filter, because
  /// the filter was computed from the samples that estimate its error.
  static constexpr double kRawAdvantage = 0.05;
  /// Fraction of the raw image's variance by which a mixture must be better than the raw image.
  static constexpr double kLeastGain = 0.1;
  /// Fraction of the raw image's variance by which the neighbours of a frame must lower the error.
  static constexpr double kLeastFusedGain = 1e-3;
  /// Tolerances of the guides' differences between two frames, as kFilterNoise and
  /// kFilterTolerance.
  static constexpr float kFusionNoise = 4, kFusionTolerance = 1e-3f;
  /// Pixels of another frame with a smaller bilinear share are left out.
  static constexpr float kMinTapShare = 0.05f;
  /// Pixels by which the motion to another frame and back may miss, and fraction of the motion that
  /// is added.
  static constexpr float kMotionTolerance = 1.25f, kMotionSpread = 0.05f;
  static constexpr float kErrorFloor = 0.01f;  // as in the contract's error
};

/// (1 − d/8)⁸, close to e⁻ᵈ, and 0 from d = 8 on. T is float or a vector of floats.
template <typename T>
T filter_weight(T distance) {
  T t = 1.0f - distance * 0.125f;
  t = t > 0 ? t : T{};
  t *= t;
  t *= t;
  return t * t;
}

}  // namespace tessera::image
