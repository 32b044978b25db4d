#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "contract/render_settings.h"
#include "worker/gltf/build/loader.h"
#include "worker/gltf/validate/validate.h"
#include "worker/scene/features.h"

namespace tessera::render {

/// Result of `inspect`.
struct InspectReport {
  struct Resource {
    std::string uri;   // as named in the manifest
    std::string file;  // path on disk
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
  bool posed = false;  // features and bounds are set
  SceneFeatures features;
  std::array<double, 3> bounds_min = {}, bounds_max = {};  // world, metres
  std::optional<ValidationResult> validation;              // if it was requested
  /// Additional members of the JSON document: name and JSON text.
  std::vector<std::pair<std::string, std::string>> extras;

  /// Returns whether an error was found: the scene cannot be rendered, or is not valid.
  [[nodiscard]] bool has_errors() const;
};

struct InspectRequest {
  std::filesystem::path scene;        // a glTF file
  std::filesystem::path environment;  // environment map file; empty: none
  contract::RenderSettings settings;  // camera, variant, frames; `environment` names the map
  bool validate = false;              // check the file against the specification too
  /// Examines the posed scene and extends the report; may be null.
  std::function<void(const Scene&, InspectReport&)> examine = nullptr;
};

/// Loads and poses the first frame of `request` and reports the findings. Faults of the scene are
/// findings, not failures. The manifest names the environment map `settings.environment`, or by its
/// file name if that is empty.
InspectReport inspect_scene(const InspectRequest& request);

/// The report as JSON, schema tessera.inspect/1, with a final newline.
std::string to_json(const InspectReport& report);

}  // namespace tessera::render
