#pragma once

#include <optional>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/gltf/animation/pose_cache.h"
#include "worker/gltf/build/loader.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Input of posing.
struct PoseInput {
  const GltfModel& model;
  ResourceReader& reader;              // for reading textures that exceed the memory limit
  const Image* environment = nullptr;  // of settings.environment; null: none
  const contract::RenderSettings& settings;
  double seconds = 0;           // since the start of the animations
  std::optional<Vec3d> center;  // placed at the origin; default: centre of the visible scene
};

/// The scene at one time, before the motion during the exposure is added. It has no solids yet, and
/// contains instances with singular transforms, marked by Instance::flat.
struct PosedScene {
  Scene scene;
  std::vector<std::int32_t> order;  // visible nodes, depth first
};

/// Builds the scene at one time. Reuses entries of `cache`, left by any earlier pose of the same
/// file, and replaces them by those it used. Appends warnings and notes to `problems`, except those
/// already given for cached data. Errors: InvalidArgument or, beyond the memory, ResourceExhausted,
/// "ELEMENT: FAULT".
absl::StatusOr<PosedScene> build_scene(const PoseInput& input, PoseCache& cache,
                                       std::vector<Problem>& problems);

/// Completes a pose to which motion was added: drops flat instances that do not move, with a
/// warning, and assembles the solids. Errors: those of assemble_solids().
absl::StatusOr<Scene> finish_scene(const GltfModel& model, PosedScene posed,
                                   std::vector<Problem>& problems);

}  // namespace tessera::render
