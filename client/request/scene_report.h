#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"

namespace tessera::client {

/// Result of `tessera-worker inspect`. The loader runs in that child process, never in this one.
struct SceneReport {
  struct Resource {
    std::string uri, file;  // name in the manifest, local path
  };
  struct Problem {
    std::string severity, file, element, message;  // severity: error, warning, note
    /// "FILE: ELEMENT: FAULT".
    std::string text() const {
      return file + ": " + (element.empty() ? message : element + ": " + message);
    }
  };
  std::string scene_uri;
  std::vector<Resource> resources;  // the glTF file and the files it references
  std::vector<Problem> problems;
  std::string json;  // the complete report, schema tessera.inspect/1

  bool has_errors() const;
};

/// Inspects `scene` in a child process. `settings`: settings of the job, to detect, for example, a
/// missing camera; may be null. `environment`: path of the environment map; empty: none.
/// `further`: more options of `tessera-worker inspect`.
///
/// Errors: NotFound, tessera-worker is not installed beside this program; InvalidArgument, the
/// child crashed on the scene or rejected its arguments (and has printed why); Internal, its output
/// is not a report; Cancelled, the child was interrupted.
absl::StatusOr<SceneReport> inspect_scene(const std::string& scene, const std::string& environment,
                                          const contract::RenderSettings* settings,
                                          const std::vector<std::string>& further = {});

}  // namespace tessera::client
