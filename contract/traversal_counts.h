#pragma once

#include <cstdint>

namespace tessera::contract {

/// Work of ray queries in an acceleration structure.
struct TraversalCounts {
  std::int64_t rays = 0;        // queries
  std::int64_t nodes = 0;       // nodes or cells visited
  std::int64_t primitives = 0;  // triangles and solids tested

  TraversalCounts& operator+=(const TraversalCounts& other) {
    rays += other.rays;
    nodes += other.nodes;
    primitives += other.primitives;
    return *this;
  }
  TraversalCounts operator-(const TraversalCounts& other) const {
    return {rays - other.rays, nodes - other.nodes, primitives - other.primitives};
  }
  bool operator==(const TraversalCounts&) const = default;
};

}  // namespace tessera::contract
