#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/gltf/file/resource_reader.h"
#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Elements of a file that settings can select, by name (empty if unnamed).
struct SceneContents {
  struct Clip {
    std::string name;
    double seconds = 0;  // time of the last key
  };
  std::vector<std::string> scenes, cameras, variants, extensions_used, extensions_required;
  std::vector<Clip> animations;
};

/// A parsed and checked glTF file with its environment map, not yet posed. Refers to the bytes of
/// its reader, which must outlive it. pose() is thread-safe.
class SceneFile {
 public:
  virtual ~SceneFile() = default;
  /// Warnings and notes found so far, including those of pose(); errors are returned as statuses.
  /// Must not be called during pose().
  virtual const std::vector<Problem>& problems() const = 0;
  virtual SceneContents contents() const = 0;
  /// URIs of all buffer and image files that it refers to, in order, without data URIs.
  virtual const std::vector<std::string>& resources() const = 0;
  /// The scene at frame `frame` of `settings` (time frame / fps), with its camera, variant and
  /// environment. Errors: InvalidArgument with file, element and fault.
  virtual absl::StatusOr<Scene> pose(const contract::RenderSettings& settings,
                                     std::int32_t frame) const = 0;
};

/// Reads `uri` (.gltf or .glb, recognised by content) and everything it refers to;
/// `settings.environment` is read through the same reader. All input is untrusted: see
/// docs/reference/limits.md.
///
/// Errors: InvalidArgument, NotFound, or Unimplemented (an unknown required extension), as "FILE:
/// ELEMENT: FAULT".
absl::StatusOr<std::unique_ptr<SceneFile>> load_scene_file(std::string_view uri,
                                                           const contract::RenderSettings& settings,
                                                           ResourceReader& reader);

}  // namespace tessera::render
