#pragma once

#include <optional>

#include "worker/geometry/motion.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Where things are while the shutter is open, at a time in [0, 1]. Requires Scene::key_times of
/// what moves.

/// Of an instance; nullopt while it is singular: nothing of it is met then.
inline std::optional<Pose> pose_of(const Scene& scene, const Instance& instance, float time) {
  if (instance.motion == kNone) return Pose{instance.object_to_world, instance.world_to_object};
  return pose_at(scene.motions[static_cast<std::size_t>(instance.motion)],
                 find_key(scene.key_times, time));
}

inline PunctualPose pose_of(const Scene& scene, const PunctualLight& light, float time) {
  if (light.keys.empty()) return {light.position, light.direction};
  const KeyframePosition at = find_key(scene.key_times, time);
  return between(light.keys[at.segment], light.keys[at.segment + 1], at.f);
}

}  // namespace tessera::render
