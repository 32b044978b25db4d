// exact_reciprocals.sh must refuse this object.
#include <immintrin.h>

float approximate_reciprocal(float x) {
  return _mm_cvtss_f32(_mm_sqrt_ss(_mm_rcp_ss(_mm_set_ss(x))));
}
