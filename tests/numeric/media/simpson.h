#pragma once

namespace tessera::testing {

/// Composite Simpson rule with `steps` (even) intervals.
template <typename F>
double integral(const F& f, double from, double to, int steps) {
  double sum = f(from) + f(to);
  const double h = (to - from) / steps;
  for (int i = 1; i < steps; ++i) sum += f(from + i * h) * (i % 2 == 1 ? 4 : 2);
  return sum * h / 3;
}

}  // namespace tessera::testing
