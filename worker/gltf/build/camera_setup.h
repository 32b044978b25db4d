#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/math/transform.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A posed scene's nodes, as far as a camera needs them.
struct PosedNodes {
  const std::vector<std::int32_t>& order;  // depth first, visible ones
  const std::vector<Affine3d>& world;      // by node, not recentred
  Vec3d center, bounds_min, bounds_max;    // bounds recentred
};

/// The camera of design.md, "Camera": the one `settings` names (node name, camera name, or index
/// into the file's cameras), else the scene's first, else all of the scene framed. Scales of the
/// camera's node are ignored, as glTF wants. Errors: InvalidArgument.
absl::StatusOr<Camera> set_up_camera(const GltfModel& document,
                                     const contract::RenderSettings& settings,
                                     const PosedNodes& nodes, std::vector<Problem>& problems);

/// Map with orthonormal axes from `world`: its directions without scale and shear; nullopt when
/// they vanish.
std::optional<Affine3d> rigid_part(const Affine3d& world);

}  // namespace tessera::render
