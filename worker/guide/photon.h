#pragma once

#include <cstdint>

#include "worker/math/vector.h"

namespace tessera::render {

/// Light that arrives at a surface.
struct Photon {
  Vec3f position;   // world
  Vec3f direction;  // unit, towards where the light comes from
  Vec3f normal;     // geometric, on that side
  float flux = 0;   // luminance, relative to the mean of emitted photons; above 0
  float share = 1;  // of light that light sampling does not find, among all that arrives about
                    // here; 0: this photon is of light that light sampling finds
  /// Key of its light and of the mirrors and lenses on its way; 0 if there are none, or if a
  /// surface that is not smooth scattered it.
  std::uint64_t way = 0;
  std::uint64_t path = 0;  // key of its random numbers; in a chain, of the path that it starts from

  /// Photons of different halves do not depend on each other.
  bool in_second_half() const { return (path & 1) != 0; }
};

}  // namespace tessera::render
