#pragma once

#include <vector>

#include "absl/status/status.h"
#include "worker/gltf/animation/pose_cache.h"
#include "worker/gltf/file/memory_budget.h"
#include "worker/gltf/file/resource_reader.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Where the textures of a scene come from.
struct TextureInput {
  const GltfModel& model;
  ResourceReader& reader;         // for reading textures that exceed the memory limit
  const std::vector<bool>& used;  // by material
  const PoseCache& cache;         // of the previous pose
  PoseCache& next_cache;          // receives the images
  MemoryBudget& memory;           // of the scene
};

/// Sets Scene::textures, images and procedural_textures. Decodes each image that a used material
/// reads, once, and copies each procedural texture that it uses; clears all other references.
/// Errors: InvalidArgument if an image cannot be decoded or all together are too large;
/// ResourceExhausted if they exceed the memory.
absl::Status add_textures(const TextureInput& input, Scene& scene, std::vector<Problem>& problems);

}  // namespace tessera::render
