#pragma once

#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/gltf/build/loader.h"
#include "worker/gltf/animation/pose_cache.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// What the loader hands over for posing.
struct PoseInput {
  const GltfModel& document;
  ResourceReader& reader;      // for texels that do not fit into memory
  const Image* sky = nullptr;  // of settings.environment; null: none
  const contract::RenderSettings& settings;
  double seconds = 0;           // since the animations began
  std::optional<Vec3d> center;  // to put at the origin; by default the middle of what is seen
};

/// The scene at one time. Takes what it can from `cache`, of any earlier pose of the document, and
/// leaves there what it used. Appends warnings and notes to `problems`, not again for what was
/// cached. Errors: InvalidArgument "ELEMENT: FAULT".
absl::StatusOr<Scene> build_scene(const PoseInput& input, PoseCache& cache,
                                  std::vector<Problem>& problems);

}  // namespace tessera::render
