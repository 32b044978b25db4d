#pragma once

#include <cstdint>
#include <vector>

#include "worker/geometry/triangle_overlap.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// Two triangles that overlap (triangles_overlap()), by their ids in the mesh.
struct OverlapPair {
  struct Id {
    std::uint32_t primitive, triangle;
    auto operator<=>(const Id&) const = default;
  };
  Id a, b;
  auto operator<=>(const OverlapPair&) const = default;
};

/// Finds the pairs of overlapping triangles of one mesh, with a < b, in ascending order. Exact, in
/// object space.
std::vector<OverlapPair> self_intersections(const Mesh& mesh);

/// Considers only the triangles of the selected primitives.
std::vector<OverlapPair> self_intersections(const Mesh& mesh, const std::vector<bool>& primitives);

/// Two instances with overlapping triangles.
struct InstanceOverlap {
  std::uint32_t a, b;  // a < b
  std::vector<OverlapPair> pairs;
};

/// Finds all pairs of instances with overlapping triangles, in ascending order. Exact for their
/// corners in world space, rounded to float.
std::vector<InstanceOverlap> instance_overlaps(const Scene& scene);

/// Counts the boundary edges of the selected primitives: the edges that their triangles do not use
/// equally often in both directions. A closed surface has none. Corners count as one vertex if
/// their coordinates are equal or, with `tolerance` > 0, differ by at most that per axis from the
/// first of them.
std::int64_t boundary_edges(const Mesh& mesh, const std::vector<bool>& primitives,
                            double tolerance = 0);

}  // namespace tessera::render
