#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "contract/render_settings.h"
#include "worker/gltf/build/loader.h"
#include "worker/scene/features.h"

namespace tessera::render {

/// What `inspect` finds in a scene.
struct InspectReport {
  struct Resource {
    std::string uri;   // as the manifest names it
    std::string file;  // where it is on disk
    std::string kind;  // scene, data or environment
    std::int64_t bytes = 0;
  };
  struct Finding {
    std::string file;
    Problem problem;
  };
  std::string scene;  // manifest URI of the glTF file
  std::vector<Resource> resources;
  std::vector<Finding> findings;
  SceneContents contents;
  bool posed = false;  // needs and bounds are set
  SceneFeatures needs;
  std::array<double, 3> bounds_min = {}, bounds_max = {};  // world, metres
  /// Further members of the document: name and JSON text.
  std::vector<std::pair<std::string, std::string>> extras;

  /// Whether an error was found: such a scene cannot be rendered.
  [[nodiscard]] bool has_errors() const;
};

struct InspectRequest {
  std::filesystem::path scene;        // a glTF file
  std::filesystem::path environment;  // a sky's file; empty: none
  contract::RenderSettings settings;  // camera, variant, frames; `environment` names the sky
  /// Looks further at the posed scene and adds to the report; may be null.
  std::function<void(const Scene&, InspectReport&)> examine = nullptr;
};

/// Loads and poses the first frame of `request` and reports what was found. Faults of the scene
/// are findings, not failures. A sky is named `settings.environment` in the manifest, or its file
/// name where that is empty.
InspectReport inspect_scene(const InspectRequest& request);

/// The report as JSON, schema tessera.inspect/1, ending in a line break.
std::string to_json(const InspectReport& report);

}  // namespace tessera::render
