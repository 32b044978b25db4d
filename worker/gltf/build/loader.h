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

/// What a file offers to choose from, by name (empty where it has none).
struct SceneContents {
  struct Clip {
    std::string name;
    double seconds = 0;  // time of its last key
  };
  std::vector<std::string> scenes, cameras, variants, extensions_used, extensions_required;
  std::vector<Clip> animations;
};

/// A parsed glTF file and its sky, checked, not yet posed at a time. Looks into the bytes of its
/// reader, which must outlive it. Safe to pose from several threads.
class SceneFile {
 public:
  virtual ~SceneFile() = default;
  /// Warnings and notes met so far, by pose() too; errors are returned as statuses. Not while
  /// another thread poses.
  virtual const std::vector<Problem>& problems() const = 0;
  virtual SceneContents contents() const = 0;
  /// URIs of all resources the file names (buffers, images), in order, without data URIs.
  virtual const std::vector<std::string>& resources() const = 0;
  /// The scene at frame `frame` of `settings` (time frame / fps), with its camera, variant and
  /// environment. Errors: InvalidArgument naming file, element and fault.
  virtual absl::StatusOr<Scene> pose(const contract::RenderSettings& settings,
                                     std::int32_t frame) const = 0;
};

/// Reads `uri` (.gltf or .glb, told by content) and everything it needs; `settings.environment`
/// is read through the same reader. Every input is hostile: limits of farm.md, section 9.
///
/// Errors: InvalidArgument or Unimplemented (an unknown required extension) or NotFound, as
/// "FILE: ELEMENT: FAULT".
absl::StatusOr<std::unique_ptr<SceneFile>> load_scene_file(std::string_view uri,
                                                           const contract::RenderSettings& settings,
                                                           ResourceReader& reader);

}  // namespace tessera::render
