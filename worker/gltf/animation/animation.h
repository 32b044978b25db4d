#pragma once

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Animations chosen by `selection`: a name, an index, "all", "none", or empty for the first.
/// Errors: InvalidArgument when there is no such animation.
absl::StatusOr<std::vector<std::int32_t>> choose_animations(const GltfModel& document,
                                                            const std::string& selection);

/// Time of an animation's last key, seconds. Requires check_animations().
double clip_seconds(const GltfModel& document, std::int32_t animation);

/// A time at which an animation has a key, and whether something jumps there (STEP).
struct AnimationKey {
  double seconds = 0;
  bool jumps = false;
};

/// Those after `from` and before `to`, in order, of what moves nodes; several at one time are one.
/// Requires check_animations().
std::vector<AnimationKey> animation_keys(const GltfModel& document,
                                         const std::vector<std::int32_t>& animations, double from,
                                         double to);

/// Checks what posing relies on: key times are finite and increase, outputs have the right shape
/// and are finite. Errors: InvalidArgument "animations[i].channels[k]: ...".
absl::Status check_animations(const GltfModel& document);

/// Sets the animated properties of `nodes` to their values at `seconds`, clamped to each
/// channel's keys. Step, linear (spherical for rotations) and cubic spline interpolation as the
/// glTF 2.0 specification, appendix C, defines them. Requires check_animations().
absl::Status animate(const GltfModel& document, std::int32_t animation, double seconds,
                     std::vector<Node>& nodes);

/// Numbers of a pointer channel at `seconds`. Requires check_animations().
absl::StatusOr<std::vector<double>> pointer_values(const GltfModel& document, std::int32_t animation,
                                                   const PointerChannel& channel, double seconds);

/// Quaternion from a to b along the shorter arc, f in [0, 1]; unit when a and b are.
Vec4d slerp(const Vec4d& a, Vec4d b, double f);

}  // namespace tessera::render
