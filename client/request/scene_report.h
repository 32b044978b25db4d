#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"

namespace tessera::client {

/// What `tessera-worker inspect` says of a scene: the loader runs in that child, never here.
struct SceneReport {
  struct Resource {
    std::string uri, file;  // name in the manifest, path on this disk
  };
  struct Problem {
    std::string severity, file, element, message;  // severity: error, warning, note
    /// "FILE: ELEMENT: FAULT".
    std::string text() const {
      return file + ": " + (element.empty() ? message : element + ": " + message);
    }
  };
  std::string scene_uri;
  std::vector<Resource> resources;  // the glTF file and everything it names
  std::vector<Problem> problems;
  std::string json;  // the whole report, schema tessera.inspect/1

  bool has_errors() const;
};

/// Runs the child on `scene` (and, if given, the settings a job will have, so that a camera or
/// variant that is not there is found now). `environment`: the sky's file; empty: none. `further`
/// options of the child make its report longer.
///
/// Errors: NotFound, no tessera-worker beside this program; InvalidArgument, the scene is beyond
/// inspection (no such file, or the child died on it: how, and what it last wrote) or an option
/// is one the child does not take (which it has said); Internal, it
/// wrote something else than a report. Cancelled when it was interrupted.
absl::StatusOr<SceneReport> inspect_scene(const std::string& scene, const std::string& environment,
                                       const contract::RenderSettings* settings,
                                       const std::vector<std::string>& further = {});

}  // namespace tessera::client
