#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// What one structure costs and gives on the rays of a scene, on one thread in CPU time.
struct AcceleratorStats {
  struct Query {
    double mrays = 0;                      // million rays a second
    double nodes = -1, triangles = -1;     // per ray: visited and tested; negative: not counted
    std::int64_t compared = 0, wrong = 0;  // rays whose answer was compared; those that differed
  };
  std::string name, title;
  double build_seconds = 0;
  std::int64_t memory_bytes = 0;
  double sah = -1, end_point_overlap = -1;  // of TreeQuality; negative: not measured
  Query closest, any;
};

struct AcceleratorTable {
  std::int64_t camera_rays = 0, bounce_rays = 0, shadow_rays = 0;
  std::vector<AcceleratorStats> rows;
};

struct AcceleratorRequest {
  std::string only;                // name of a reference structure; empty: all
  double seconds_per_query = 0.3;  // how long each is asked
};

/// Renders a small image of the scene's frame, writes down the rays that takes (from the camera,
/// after at most three bounces, towards the lights), and asks them again of the production
/// structure, of the same with a shadow cache and of other build qualities, and of the reference
/// structures. Their answers are
/// compared with production's. A structure that is too slow for all rays gets a spread of them.
///
/// Errors: InvalidArgument, the scene or the settings cannot be rendered.
absl::StatusOr<AcceleratorTable> measure_accelerators(const Scene& scene,
                                                      const contract::RenderSettings& settings,
                                                      const AcceleratorRequest& request);

/// As JSON: the member "accelerators" of tessera.inspect/1.
std::string to_json(const AcceleratorTable& table);

}  // namespace tessera::render
