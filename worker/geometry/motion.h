#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>

#include "worker/math/transform.h"

namespace tessera::render {

// Motion during the exposure: piecewise linear between keyframes. All acceleration structures
// interpolate with these functions, so that they find the same hits.

/// A time between two keyframes.
struct KeyframePosition {
  std::uint32_t segment = 0;  // index of the keyframe before it
  float f = 0;                // fraction of the interval to the next keyframe, 0 to 1
};

/// Finds the keyframes around `time`. Requires increasing `times` from 0 to 1, and `time` in [0,
/// 1].
inline KeyframePosition find_key(std::span<const float> times, float time) {
  std::uint32_t segment = 0, after = static_cast<std::uint32_t>(times.size()) - 1;
  while (segment + 1 < after) {
    const std::uint32_t middle = (segment + after) / 2;
    (times[middle] <= time ? segment : after) = middle;
  }
  return {segment, (time - times[segment]) / (times[segment + 1] - times[segment])};
}

/// Linear interpolation clamped to [min(a, b), max(a, b)], so that a box around both ends contains
/// the result in spite of rounding.
inline float lerp_bounded(float a, float b, float f) {
  const float v = std::fma(f, b - a, a);
  const float lo = b < a ? b : a, hi = b > a ? b : a;
  const float from = lo > v ? lo : v;
  return hi < from ? hi : from;
}

inline Vec3f lerp_bounded(const Vec3f& a, const Vec3f& b, float f) {
  return {lerp_bounded(a.x, b.x, f), lerp_bounded(a.y, b.y, f), lerp_bounded(a.z, b.z, f)};
}

inline Vec2f lerp_bounded(const Vec2f& a, const Vec2f& b, float f) {
  return {lerp_bounded(a.x, b.x, f), lerp_bounded(a.y, b.y, f)};
}

inline Vec4f lerp_bounded(const Vec4f& a, const Vec4f& b, float f) {
  return {lerp_bounded(a.x, b.x, f), lerp_bounded(a.y, b.y, f), lerp_bounded(a.z, b.z, f),
          lerp_bounded(a.w, b.w, f)};
}

/// Interpolates each element: points move along straight lines, up to rounding.
inline Affine3d lerp(const Affine3d& a, const Affine3d& b, float f) {
  const auto s = static_cast<double>(f);
  Affine3d m;
  for (std::size_t k = 0; k < 3; ++k) m.rows[k] = a.rows[k] + (b.rows[k] - a.rows[k]) * s;
  m.translation = a.translation + (b.translation - a.translation) * s;
  return m;
}

/// Position and orientation of a punctual light, recentred world.
struct PunctualPose {
  Vec3d position;
  Vec3f direction = {0, 0, -1};  // unit, in which light travels

  bool operator==(const PunctualPose&) const = default;
};

inline PunctualPose lerp(const PunctualPose& a, const PunctualPose& b, float f) {
  return {a.position + (b.position - a.position) * static_cast<double>(f),
          normalize(lerp_bounded(a.direction, b.direction, f))};
}

/// Transform of an instance at one time.
struct Pose {
  Affine3d object_to_world, world_to_object;
};

/// The pose at a time, given the object-to-world transforms at the keyframes. Returns nullopt if it
/// is singular; the instance is then invisible.
inline std::optional<Pose> pose_at(std::span<const Affine3d> motion, const KeyframePosition& at) {
  const Affine3d place = lerp(motion[at.segment], motion[at.segment + 1], at.f);
  const auto inverted = inverse(place);
  if (!inverted) return std::nullopt;
  return Pose{place, *inverted};
}

}  // namespace tessera::render
