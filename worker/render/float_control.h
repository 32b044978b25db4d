#pragma once

#include <immintrin.h>

namespace tessera::render {

/// Returns whether the calling thread uses IEEE 754 defaults: round to nearest, denormals neither
/// flushed (FTZ) nor read as zero (DAZ).
inline bool has_ieee_floats() {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040, kRounding = 0x6000;
  return (_mm_getcsr() & (kFlushToZero | kDenormalsAreZero | kRounding)) == 0;
}

}  // namespace tessera::render
