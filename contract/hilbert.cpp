#include "contract/hilbert.h"

#include <cstdlib>

namespace tessera::contract {
namespace {

int sign(std::int32_t v) {
  return v > 0 ? 1 : v < 0 ? -1 : 0;
}

/// Returns half of v, rounded towards zero and moved one away from zero if that makes it even: the
/// curve leaves an even part on the side where the next one begins.
std::int32_t even_half(std::int32_t v) {
  const std::int32_t half = v / 2;
  return half % 2 != 0 && std::abs(v) > 2 ? half + sign(v) : half;
}

/// A block to fill: from `at`, along the major axis (ax, ay) and across the minor axis (bx, by).
/// The curve enters at `at` and leaves at the far end of the major axis.
struct Block {
  GridPoint at;
  GridPoint major, minor;
};

class Curve {
 public:
  explicit Curve(std::vector<GridPoint>& out) : out_(out) {}

  void fill(const Block& block) {
    const auto [at, a, b] = block;
    const std::int32_t length = std::abs(a.x + a.y), breadth = std::abs(b.x + b.y);
    const GridPoint da = {sign(a.x), sign(a.y)}, db = {sign(b.x), sign(b.y)};
    if (breadth == 1) return line(at, da, length);
    if (length == 1) return line(at, db, breadth);

    const bool long_block = 2 * length > 3 * breadth;
    if (long_block) {  // two halves one after the other
      const GridPoint half = {even_half(a.x), even_half(a.y)};
      fill({at, half, b});
      fill({{at.x + half.x, at.y + half.y}, {a.x - half.x, a.y - half.y}, b});
      return;
    }
    // Up across the first half, along the far side, back down across the second half.
    const GridPoint half_a = {a.x / 2, a.y / 2};
    const GridPoint half_b = {even_half(b.x), even_half(b.y)};
    fill({at, half_b, half_a});
    fill({{at.x + half_b.x, at.y + half_b.y}, a, {b.x - half_b.x, b.y - half_b.y}});
    fill({{at.x + (a.x - da.x) + (half_b.x - db.x), at.y + (a.y - da.y) + (half_b.y - db.y)},
          {-half_b.x, -half_b.y},
          {-(a.x - half_a.x), -(a.y - half_a.y)}});
  }

 private:
  void line(GridPoint at, GridPoint step, std::int32_t count) {
    for (std::int32_t i = 0; i < count; ++i) {
      out_.push_back(at);
      at = {at.x + step.x, at.y + step.y};
    }
  }

  std::vector<GridPoint>& out_;
};

}  // namespace

std::vector<GridPoint> hilbert_curve(std::int32_t width, std::int32_t height) {
  std::vector<GridPoint> points;
  points.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  Curve curve(points);
  if (width >= height) {
    curve.fill({{0, 0}, {width, 0}, {0, height}});
  } else {
    curve.fill({{0, 0}, {0, height}, {width, 0}});
  }
  return points;
}

}  // namespace tessera::contract
