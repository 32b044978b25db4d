#pragma once

#include <array>

namespace tessera::render {

/// The real roots of sum_i coefficients[i] x^i in [low, high], rising; returns how many. A place
/// where the polynomial touches zero, to the rounding of its evaluation, is a root twice. Requires
/// the polynomial to be positive at both ends (within which all of an even number of roots lie)
/// and at least one coefficient of x to be other than 0.
///
/// Between two zeros of its derivative a polynomial has one root at most, which bisection guards
/// and Newton's method sharpens; those zeros are found in the same way. Unlike Ferrari's formula
/// this loses no root to cancellation.
int real_roots(const std::array<double, 5>& coefficients, double low, double high,
               std::array<double, 4>& roots);

}  // namespace tessera::render
