#include "worker/geometry/shapes/polynomial_roots.h"

#include <cmath>

namespace tessera::render {
namespace {

/// A value and a bound of its rounding error.
struct Estimate {
  double value, error;
  int sign() const { return value > error ? 1 : value < -error ? -1 : 0; }
};

/// A polynomial of degree at most 4.
class Polynomial {
 public:
  Polynomial(const std::array<double, 5>& coefficients, int degree)
      : c_(coefficients), degree_(degree) {}

  double at(double x) const {
    double sum = 0;
    for (int i = degree_; i >= 0; --i) sum = sum * x + c_[static_cast<std::size_t>(i)];
    return sum;
  }

  /// Horner's rule rounds twice per step: its error is at most 2 n u of the sum of the terms'
  /// magnitudes (Higham, "Accuracy and stability of numerical algorithms", section 5.1). Doubled
  /// for the errors of the coefficients.
  Estimate estimate(double x) const {
    double size = 0;
    for (int i = degree_; i >= 0; --i) {
      size = size * std::fabs(x) + std::fabs(c_[static_cast<std::size_t>(i)]);
    }
    return {at(x), 4 * degree_ * 0x1p-53 * size};
  }

  Polynomial derivative() const {
    std::array<double, 5> d{};
    for (std::size_t i = 1; i <= static_cast<std::size_t>(degree_); ++i) {
      d[i - 1] = c_[i] * static_cast<double>(i);
    }
    return {d, degree_ - 1};
  }

  int degree() const { return degree_; }

  /// The root between a and b. Requires different signs there.
  double root_between(double a, double b, bool rising) const {
    const Polynomial slope = derivative();
    const double near = 0x1p-53 * (std::fabs(a) + std::fabs(b));
    double x = 0.5 * (a + b);
    for (;;) {
      const double y = at(x);
      if (y == 0) return x;
      ((y < 0) == rising ? a : b) = x;
      double next = x - y / slope.at(x);
      if (std::fabs(next - x) <= near) return next;
      if (!(next > a && next < b)) next = 0.5 * (a + b);
      if (!(a < next && next < b)) return x;
      x = next;
    }
  }

 private:
  std::array<double, 5> c_;
  int degree_;
};

/// Finds the points where the polynomial changes sign and, with `touches`, those where it touches
/// zero, which are stored twice. Returns the number of roots.
int sign_changes(const Polynomial& p, double low, double high, bool touches,
                 std::array<double, 4>& roots) {
  std::array<double, 4> turns{};
  const int turn_count = p.degree() > 1 ? sign_changes(p.derivative(), low, high, false, turns) : 0;
  int count = 0, last_sign = p.estimate(low).sign();
  double last = low;     // where it had last_sign
  bool at_zero = false;  // whether it has been zero since then
  double zero = low;     // where it was zero
  for (int i = 0; i <= turn_count; ++i) {
    const double x = i < turn_count ? turns[static_cast<std::size_t>(i)] : high;
    const int sign = p.estimate(x).sign();
    if (sign == 0) {
      at_zero = true;
      zero = x;
      continue;
    }
    if (at_zero) {
      if (sign != last_sign && last_sign != 0) {
        roots[static_cast<std::size_t>(count++)] = zero;
      } else if (touches) {
        roots[static_cast<std::size_t>(count++)] = zero;
        roots[static_cast<std::size_t>(count++)] = zero;
      }
    } else if (sign != last_sign && last_sign != 0) {
      roots[static_cast<std::size_t>(count++)] = p.root_between(last, x, sign > 0);
    }
    at_zero = false;
    last = x;
    last_sign = sign;
  }
  return count;
}

}  // namespace

int real_roots(const std::array<double, 5>& coefficients, double low, double high,
               std::array<double, 4>& roots) {
  return sign_changes(Polynomial(coefficients, 4), low, high, true, roots);
}

}  // namespace tessera::render
