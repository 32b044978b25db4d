#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/math/transform.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A posed scene, as needed to place a camera.
struct PosedNodes {
  const std::vector<std::int32_t>& order;  // visible nodes, depth first
  const std::vector<Affine3d>& world;      // by node index, not recentred
  const Scene& scene;                      // instances are recentred
};

/// The camera of a frame (docs/explanation/determinism.md#scene-conventions): the one that
/// `settings` names (by node name, camera name or index into the file's cameras), otherwise the
/// scene's first, otherwise one that frames the whole scene. Scales of the camera's node are
/// ignored, as glTF requires. Errors: InvalidArgument.
absl::StatusOr<Camera> set_up_camera(const GltfModel& model,
                                     const contract::RenderSettings& settings,
                                     const PosedNodes& nodes, std::vector<Problem>& problems);

/// `world` without scale and shear, with orthonormal axes; nullopt if its axes vanish.
std::optional<Affine3d> rigid_part(const Affine3d& world);

}  // namespace tessera::render
