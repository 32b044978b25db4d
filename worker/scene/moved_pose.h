#pragma once

#include <optional>

#include "worker/geometry/motion.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Pose of an instance at `time`, in [0, 1] of the exposure. nullopt while its transform is
/// singular: rays cannot hit it then. Requires Scene::key_times if the instance moves.
inline std::optional<Pose> pose_of(const Scene& scene, const Instance& instance, float time) {
  if (instance.motion == kNone) return Pose{instance.object_to_world, instance.world_to_object};
  return pose_at(scene.motions[static_cast<std::size_t>(instance.motion)],
                 find_key(scene.key_times, time));
}

/// Pose of a punctual light at `time`, in [0, 1] of the exposure.
inline PunctualPose pose_of(const Scene& scene, const PunctualLight& light, float time) {
  if (light.keys.empty()) return {light.position, light.direction};
  const KeyframePosition at = find_key(scene.key_times, time);
  return lerp(light.keys[at.segment], light.keys[at.segment + 1], at.f);
}

}  // namespace tessera::render
