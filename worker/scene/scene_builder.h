#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "proto/contract/render_settings.h"
#include "worker/scene/document.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// What the loader hands over for posing.
struct PoseInput {
  const Document& document;
  const Image* sky = nullptr;  // of settings.environment; null: none
  const contract::RenderSettings& settings;
  std::int32_t frame = 0;
};

/// The scene at one frame. Appends warnings and notes to `problems`.
/// Errors: InvalidArgument "ELEMENT: FAULT".
absl::StatusOr<Scene> build_scene(const PoseInput& input, std::vector<Problem>& problems);

}  // namespace tessera::render
