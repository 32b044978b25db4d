#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "contract/render_settings.h"
#include "worker/inspect/near_vertices.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Cost and speed of one acceleration structure on the rays of a scene, single-threaded CPU time.
struct AcceleratorStats {
  struct Query {
    double mrays = 0;  // million rays per second
    double nodes = -1,
           triangles = -1;  // nodes visited and triangles tested per ray; negative: not counted
    double decided = -1;    // share of rays that a shadow map answered; negative: not measured
    std::int64_t compared = 0, wrong = 0;  // rays compared with production, and those that differed
  };
  std::string name, title;
  double build_seconds = 0;
  std::int64_t memory_bytes = 0;
  double sah = -1, end_point_overlap = -1;  // from TreeQuality; negative: not measured
  Query closest, any;
};

struct AcceleratorTable {
  std::int64_t camera_rays = 0, bounce_rays = 0, shadow_rays = 0;
  std::vector<AcceleratorStats> rows;
  VertexDistances nearest;  // searches for the nearest vertex, of at most 2^16 vertices
};

struct AcceleratorRequest {
  std::string only;                // name of a reference structure; empty: all
  double seconds_per_query = 0.3;  // measuring time
};

/// Renders a small image of the scene's frame, records its rays (camera rays, rays of at most three
/// bounces, shadow rays) and traces them again with the production structure, with variants of it
/// (shadow cache, shadow map, other build qualities) and with the reference structures. Compares
/// their answers with production's. A structure too slow for all rays gets an evenly spaced subset.
///
/// Errors: InvalidArgument if the scene or the settings cannot be rendered.
absl::StatusOr<AcceleratorTable> measure_accelerators(const Scene& scene,
                                                      const contract::RenderSettings& settings,
                                                      const AcceleratorRequest& request);

/// The member "accelerators" of tessera.inspect/1, as JSON.
std::string to_json(const AcceleratorTable& table);

}  // namespace tessera::render
