// no_libm.sh must refuse this object.
#include <cmath>

float sine_of_the_library(float x) {
  return std::sin(x);
}
