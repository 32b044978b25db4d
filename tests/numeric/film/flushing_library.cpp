// A library that flushes denormals (FTZ) and reads them as zero (DAZ) as soon as it is loaded, as
// those do that GCC 12 or Clang 14 link with -ffast-math.

#include <immintrin.h>

namespace {

[[gnu::constructor]] void flush_denormals() {
  constexpr unsigned kFlushToZero = 0x8000, kDenormalsAreZero = 0x0040;
  _mm_setcsr(_mm_getcsr() | kFlushToZero | kDenormalsAreZero);
}

}  // namespace
