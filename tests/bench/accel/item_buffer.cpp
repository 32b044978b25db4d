#include "tests/bench/accel/item_buffer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tests/bench/accel/rays.h"

namespace tessera::render::bench {
namespace {

/// A projected corner: x and y in pixels, multiplied by the depth, and the depth along the axis. In
/// double, because triangles clipped by the near plane extend over millions of pixels.
struct Projected {
  double x, y, depth;
};

class Rasteriser {
 public:
  Rasteriser(const BenchScene& bench, int side)
      : view_(bench), side_(side), nearest_(pixels(), 0.0) {
    out_.items.resize(pixels());
    near_ = 1e-4 * static_cast<double>(bench.scale);
  }

  void add(const std::array<Vec3f, 3>& corners, const TriangleId& id) {
    std::array<Projected, 4> polygon{};
    std::size_t count = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Projected a = project(corners[i]), b = project(corners[(i + 1) % 3]);
      if (a.depth >= near_) polygon[count++] = a;
      if ((a.depth >= near_) == (b.depth >= near_)) continue;
      const double s = (near_ - a.depth) / (b.depth - a.depth);
      polygon[count++] = {a.x + (b.x - a.x) * s, a.y + (b.y - a.y) * s, near_};
    }
    for (std::size_t i = 2; i < count; ++i) fill(polygon[0], polygon[i - 1], polygon[i], id);
  }

  ItemBuffer take() && { return std::move(out_); }

 private:
  std::size_t pixels() const {
    return static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_);
  }

  Projected project(const Vec3f& p) const {
    const Vec3d from_eye = Vec3d(p) - Vec3d(view_.eye);
    const double depth = dot(from_eye, Vec3d(view_.forward)), half = 0.5 * side_,
                 tangent = static_cast<double>(view_.half);
    return {half * (dot(from_eye, Vec3d(view_.right)) / tangent + depth),
            half * (depth - dot(from_eye, Vec3d(view_.up)) / tangent), depth};
  }

  /// Rasterises a triangle by edge functions; 1 / depth is linear in image space.
  void fill(const Projected& a, const Projected& b, const Projected& c, const TriangleId& id) {
    const double ax = a.x / a.depth, ay = a.y / a.depth, bx = b.x / b.depth, by = b.y / b.depth,
                 cx = c.x / c.depth, cy = c.y / c.depth;
    const double area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (!(std::fabs(area) > 0)) return;
    const auto pixel = [&](double x) {
      return static_cast<int>(clamp(std::floor(x), 0.0, static_cast<double>(side_ - 1)));
    };
    const int x0 = pixel(std::min({ax, bx, cx})), x1 = pixel(std::max({ax, bx, cx}));
    const int y0 = pixel(std::min({ay, by, cy})), y1 = pixel(std::max({ay, by, cy}));
    for (int y = y0; y <= y1; ++y) {
      const double py = y + 0.5;
      for (int x = x0; x <= x1; ++x) {
        const double px = x + 0.5;
        const double u = ((cx - bx) * (py - by) - (cy - by) * (px - bx)) / area;
        const double v = ((ax - cx) * (py - cy) - (ay - cy) * (px - cx)) / area;
        const double w = 1 - u - v;
        if (!(u >= 0 && v >= 0 && w >= 0)) continue;
        ++out_.fragments;
        const double nearness = u / a.depth + v / b.depth + w / c.depth;
        const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(side_) +
                        static_cast<std::size_t>(x);
        if (!(nearness > nearest_[at])) continue;
        nearest_[at] = nearness;
        out_.items[at] = id;
      }
    }
  }

  const View view_;
  const int side_;
  double near_;
  ItemBuffer out_;
  std::vector<double> nearest_;  // 1 / depth
};

}  // namespace

ItemBuffer item_buffer(const BenchScene& bench, int side) {
  Rasteriser rasteriser(bench, side);
  for (std::uint32_t i = 0; i < bench.scene.instances.size(); ++i) {
    const Instance& instance = bench.scene.instances[i];
    const Mesh& mesh = bench.scene.meshes[static_cast<std::size_t>(instance.mesh)];
    for (std::uint32_t p = 0; p < mesh.primitives.size(); ++p) {
      const Primitive& primitive = mesh.primitives[p];
      std::vector<Vec3f> world;
      world.reserve(primitive.positions.size());
      for (const Vec3f& position : primitive.positions) {
        world.emplace_back(transform_point(instance.object_to_world, Vec3d(position)));
      }
      for (std::uint32_t t = 0; t < primitive.triangles.size(); ++t) {
        const auto& [a, b, c] = primitive.triangles[t];
        rasteriser.add({world[a], world[b], world[c]}, {i, p, t});
      }
    }
  }
  return std::move(rasteriser).take();
}

}  // namespace tessera::render::bench
