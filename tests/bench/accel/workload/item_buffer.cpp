#include "tests/bench/accel/workload/item_buffer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tests/bench/accel/workload/rays.h"

namespace tessera::render::bench {
namespace {

/// A projected corner: x and y in pixels, multiplied by the depth, and the depth along the axis. In
/// double, because triangles clipped by the near plane extend over millions of pixels.
struct Projected {
  double x, y, depth;
};

struct Point {
  double x, y;
};

/// Twice the area of the triangle (a, b, p). The two triangles at an edge compute the same number
/// with opposite signs, so that no pixel centre on the edge is left out.
double edge(const Point& a, const Point& b, const Point& p) {
  const bool swapped = b.x < a.x || (b.x == a.x && b.y < a.y);
  const Point &from = swapped ? b : a, &to = swapped ? a : b;
  const double area = (to.x - from.x) * (p.y - from.y) - (to.y - from.y) * (p.x - from.x);
  return swapped ? -area : area;
}

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
    const Point at_a = {a.x / a.depth, a.y / a.depth}, at_b = {b.x / b.depth, b.y / b.depth},
                at_c = {c.x / c.depth, c.y / c.depth};
    const double area = edge(at_a, at_b, at_c);
    if (!(std::fabs(area) > 0)) return;
    const double side = area > 0 ? 1 : -1;
    const auto pixel = [&](double x) {
      return static_cast<int>(clamp(std::floor(x), 0.0, static_cast<double>(side_ - 1)));
    };
    const int x0 = pixel(std::min({at_a.x, at_b.x, at_c.x}));
    const int x1 = pixel(std::max({at_a.x, at_b.x, at_c.x}));
    const int y0 = pixel(std::min({at_a.y, at_b.y, at_c.y}));
    const int y1 = pixel(std::max({at_a.y, at_b.y, at_c.y}));
    for (int y = y0; y <= y1; ++y) {
      for (int x = x0; x <= x1; ++x) {
        const Point p = {x + 0.5, y + 0.5};
        const double u = side * edge(at_b, at_c, p), v = side * edge(at_c, at_a, p),
                     w = side * edge(at_a, at_b, p);
        if (!(u >= 0 && v >= 0 && w >= 0)) continue;
        ++out_.fragments;
        const double nearness = (u / a.depth + v / b.depth + w / c.depth) / (side * area);
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
