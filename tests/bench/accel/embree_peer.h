#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render::bench {

/// Embree 3, quality HIGH, one thread: the measured peer.
class EmbreePeer {
 public:
  /// Builds at once. The scene must outlive it.
  explicit EmbreePeer(const Scene& scene);
  ~EmbreePeer();
  EmbreePeer(const EmbreePeer&) = delete;
  EmbreePeer& operator=(const EmbreePeer&) = delete;

  /// Each traces all rays and returns how many hit something.
  std::int64_t closest_hits(std::span<const Ray> rays) const;
  std::int64_t any_hits(std::span<const Ray> rays) const;
  /// By packets of 16; a last incomplete one is padded with invalid lanes.
  std::int64_t closest_hits_16(std::span<const Ray> rays) const;

  /// The hit of one ray: whether, and t.
  bool closest_hit(const Ray& ray, float& t) const;

  std::int64_t memory_bytes() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace tessera::render::bench
