// exact_reciprocals.sh must refuse this object.
#include <immintrin.h>

[[gnu::target("avx512f,avx512vl")]] void approximate_inverse_root(float* x) {
  _mm_storeu_ps(x, _mm_sqrt_ss(_mm_rsqrt14_ps(_mm_loadu_ps(x))));
}
