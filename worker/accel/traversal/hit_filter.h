#pragma once

#include <type_traits>

#include "worker/geometry/ray.h"

namespace tessera::render {

/// Non-owning reference to a function object bool(const Hit&), which must outlive it.
class HitFilter {
 public:
  template <typename Filter>
  explicit HitFilter(Filter& filter)
      : filter_(const_cast<void*>(static_cast<const void*>(&filter))),
        call_([](void* f, const Hit& hit) -> bool { return (*static_cast<Filter*>(f))(hit); }) {}

  bool operator()(const Hit& hit) const { return call_(filter_, hit); }

 private:
  void* filter_;
  bool (*call_)(void*, const Hit&);
};

/// Triangles of one mesh that a filtered any_hit is guaranteed to offer only once although spatial
/// splits have put them in several leaves: twice the transparency limit of a ray.
inline constexpr int kMaxTrackedTriangles = 2048;

/// Maximum number of rays that are traced together.
inline constexpr int kPacketSize = 64;

}  // namespace tessera::render
