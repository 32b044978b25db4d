#pragma once

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
};

}  // namespace tessera::render
