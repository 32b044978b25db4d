#include "worker/geometry/exact_sign.h"

#include <array>
#include <cmath>

namespace tessera::render {
namespace {

/// Exact sum of doubles, as an expansion of non-overlapping parts in ascending order.
template <std::size_t kMaxParts>
class ExactSum {
 public:
  void add(double x) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      const double sum = x + parts_[i], part = sum - x;
      const double error = (x - (sum - part)) + (parts_[i] - part);
      if (error != 0) parts_[kept++] = error;
      x = sum;
    }
    if (x != 0) parts_[kept++] = x;
    count_ = kept;
  }
  int sign() const { return count_ == 0 ? 0 : parts_[count_ - 1] > 0 ? 1 : -1; }

 private:
  std::array<double, kMaxParts> parts_{};
  std::size_t count_ = 0;
};

/// Adds sign * a b c. The product of two floats is a double; with a third it is the sum of two.
template <std::size_t kMaxParts>
void add_product(ExactSum<kMaxParts>& sum, int sign, float a, float b, float c) {
  const double ab = sign * static_cast<double>(a) * static_cast<double>(b);
  const double high = ab * static_cast<double>(c);
  sum.add(high);
  sum.add(std::fma(ab, static_cast<double>(c), -high));
}

/// Adds sign * dot(a, cross(b, c)).
template <std::size_t kMaxParts>
void add_volume(ExactSum<kMaxParts>& sum, int sign, const Vec3f& a, const Vec3f& b,
                const Vec3f& c) {
  add_product(sum, sign, a.x, b.y, c.z);
  add_product(sum, -sign, a.x, b.z, c.y);
  add_product(sum, sign, a.y, b.z, c.x);
  add_product(sum, -sign, a.y, b.x, c.z);
  add_product(sum, sign, a.z, b.x, c.y);
  add_product(sum, -sign, a.z, b.y, c.x);
}

}  // namespace

int side_of_plane(const Vec3f& a, const Vec3f& b, const Vec3f& c, const Vec3f& d) {
  // dot(a - d, cross(b - d, c - d)), first in double: at most nine roundings of differences,
  // products and sums, each by 2^-53 of the sum of the magnitudes of all products.
  const Vec3d p = Vec3d(a) - Vec3d(d), q = Vec3d(b) - Vec3d(d), r = Vec3d(c) - Vec3d(d);
  const auto size = [](double x, double y, double z, double w) {
    return std::fabs(x * y) + std::fabs(z * w);
  };
  const double volume =
      p.x * (q.y * r.z - q.z * r.y) + p.y * (q.z * r.x - q.x * r.z) + p.z * (q.x * r.y - q.y * r.x);
  const double sizes = std::fabs(p.x) * size(q.y, r.z, q.z, r.y) +
                       std::fabs(p.y) * size(q.z, r.x, q.x, r.z) +
                       std::fabs(p.z) * size(q.x, r.y, q.y, r.x);
  if (std::fabs(volume) > 0x1p-49 * sizes) return volume > 0 ? 1 : -1;
  ExactSum<48> sum;
  add_volume(sum, 1, a, b, c);
  add_volume(sum, -1, b, c, d);
  add_volume(sum, 1, c, d, a);
  add_volume(sum, -1, d, a, b);
  return sum.sign();
}

int side_of_line(const Vec3f& a, const Vec3f& b, const Vec3f& c, int axis) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  ExactSum<12> sum;
  const auto add = [&](const Vec3f& p, const Vec3f& q) {
    sum.add(static_cast<double>(p[u]) * static_cast<double>(q[v]));
    sum.add(-(static_cast<double>(p[v]) * static_cast<double>(q[u])));
  };
  add(a, b);
  add(b, c);
  add(c, a);
  return sum.sign();
}

}  // namespace tessera::render
