// baseline_isa.sh must refuse the second function.
#include <immintrin.h>

[[gnu::target("avx512f")]] void double_by_avx512(float* x) {
  _mm512_storeu_ps(x, _mm512_add_ps(_mm512_loadu_ps(x), _mm512_loadu_ps(x)));
}

[[gnu::target("avx512f")]] void double_everywhere(float* x) {
  _mm512_storeu_ps(x, _mm512_add_ps(_mm512_loadu_ps(x), _mm512_loadu_ps(x)));
}
