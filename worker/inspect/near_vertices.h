#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "worker/accelerators/points/nearest.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Two vertices that nearly coincide: a crack, through which light leaks, or a seam whose vertices
/// were rounded differently.
struct NearVertices {
  double distance = 0;         // metres, above 0
  Vec3f at;                    // one of them, recentred world
  std::int32_t nodes[2] = {};  // glTF nodes of the two
};

/// Distances between the placed vertices of a scene at its frame's time.
struct VertexDistances {
  std::int64_t vertices = 0;        // of all instances that do not deform during the exposure
  std::int64_t places = 0;          // different positions among the vertices examined
  double tolerance = 0;             // metres
  double smallest = 0, median = 0;  // distance of a place to the nearest other; 0 if there is none
  std::vector<NearVertices> near;   // pairs within the tolerance, by distance
  /// Cost of finding each place's nearest other in a kd-tree and in a BVH.
  accelerators::SearchStats kd_tree, bvh;
  std::int64_t wrong = 0;  // searches in which the trees differ; 0
};

/// Finds for each vertex the nearest one at another position. A pair is near if its distance is at
/// most 1e-5 of the scene's size. Examines the first `max_vertices`.
VertexDistances measure_vertex_distances(const Scene& scene,
                                         std::size_t max_vertices = std::size_t{1} << 23);

/// The member "nearest" of "accelerators" and "vertex_distances", as JSON: the cost of searches.
std::string search_cost_json(const VertexDistances& distances);

/// The member "vertex_distances" of tessera.inspect/1, as JSON. Lists the first 100 pairs.
std::string to_json(const VertexDistances& distances, const Scene& scene);

}  // namespace tessera::render
