#pragma once

#include <cstdint>
#include <vector>

#include "worker/geometry/triangle_overlap.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Triangles that overlap (triangles_overlap), by their ids in the mesh.
struct OverlapPair {
  struct Id {
    std::uint32_t primitive, triangle;
    auto operator<=>(const Id&) const = default;
  };
  Id a, b;
  auto operator<=>(const OverlapPair&) const = default;
};

/// Pairs of triangles of one mesh that overlap, a before b, in order. Exact, in object space.
std::vector<OverlapPair> self_intersections(const Mesh& mesh);

/// The same for triangles of the chosen primitives only.
std::vector<OverlapPair> self_intersections(const Mesh& mesh, const std::vector<bool>& primitives);

/// Two instances whose triangles overlap, and which do.
struct InstanceOverlap {
  std::uint32_t a, b;  // a < b
  std::vector<OverlapPair> pairs;
};

/// All such instances, in order. Exact for corners in the world, which are rounded to float.
std::vector<InstanceOverlap> instance_overlaps(const Scene& scene);

/// How many edges of the chosen primitives bound the surface: those run along more often one way
/// than the other. Corners are the same where their coordinates are, or with `apart` > 0 where they
/// are as near to the first of them along each axis. 0: it is closed.
std::int64_t boundary_edges(const Mesh& mesh, const std::vector<bool>& primitives,
                            double apart = 0);

}  // namespace tessera::render
