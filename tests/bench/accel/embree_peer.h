#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render::bench {

/// Embree 3 with quality HIGH and one thread.
class EmbreePeer {
 public:
  /// Builds Embree's BVH. The scene must outlive it.
  explicit EmbreePeer(const Scene& scene);
  ~EmbreePeer();
  EmbreePeer(const EmbreePeer&) = delete;
  EmbreePeer& operator=(const EmbreePeer&) = delete;

  /// Trace all rays and return the number of hits.
  std::int64_t closest_hits(std::span<const Ray> rays) const;
  std::int64_t any_hits(std::span<const Ray> rays) const;
  /// Traces rays in packets of 16; pads the last packet with invalid lanes.
  std::int64_t closest_hits_16(std::span<const Ray> rays) const;

  /// Returns whether the ray hits and sets its t.
  bool closest_hit(const Ray& ray, float& t) const;

  std::int64_t memory_bytes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tessera::render::bench
