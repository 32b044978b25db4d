#pragma once

#include <array>

namespace tessera::render {

/// Finds the real roots of sum_i coefficients[i] x^i in [low, high], in ascending order; returns
/// their number, which is even. A point where the polynomial touches zero, up to the rounding of
/// its evaluation, counts twice. Requires a polynomial that is positive at both ends and not
/// constant.
///
/// Between two zeros of its derivative a polynomial has at most one root, which is found by
/// Newton's method safeguarded by bisection; the zeros of the derivative are found in the same way.
/// Unlike Ferrari's formula this loses no root to cancellation.
int real_roots(const std::array<double, 5>& coefficients, double low, double high,
               std::array<double, 4>& roots);

}  // namespace tessera::render
