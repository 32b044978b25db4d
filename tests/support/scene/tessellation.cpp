#include "tests/support/scene/tessellation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/terrain/terrain_field.h"

namespace tessera::testing {
namespace {

using render::Box3d;
using render::Primitive;
using render::Quadric;
using render::Shape;
using render::ShapeHit;
using render::Vec2d;
using render::Vec3d;
using render::Vec3f;

constexpr double kTwoPi = 6.28318530717958647692;

/// A grid of columns by rows cells; point(u, v) with both from 0 to 1.
void add_grid(Primitive& mesh, std::uint32_t columns, std::uint32_t rows,
              const std::function<Vec3d(double, double)>& point) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  for (std::uint32_t row = 0; row <= rows; ++row) {
    for (std::uint32_t column = 0; column <= columns; ++column) {
      mesh.positions.push_back(
          Vec3f(point(static_cast<double>(column) / columns, static_cast<double>(row) / rows)));
    }
  }
  for (std::uint32_t row = 0; row < rows; ++row) {
    for (std::uint32_t column = 0; column < columns; ++column) {
      const std::uint32_t a = first + row * (columns + 1) + column, b = a + columns + 1;
      mesh.triangles.push_back({a, b, a + 1});
      mesh.triangles.push_back({a + 1, b, b + 1});
    }
  }
}

Vec3d turned(double u) {
  return {std::cos(kTwoPi * u), 0, std::sin(kTwoPi * u)};
}

/// A surface of revolution about y: the profile's radius at each height, and discs at its ends.
void add_round(Primitive& mesh, const Shape& shape, std::uint32_t n) {
  const Quadric& q = shape.quadric;
  const auto radius = [&q](double y) {
    const double r2 = -(q.squares.y * y * y + 2 * q.linear.y * y + q.constant);
    return std::sqrt(std::max(r2, 0.0));
  };
  const double low = shape.clip.lo.y, high = shape.clip.hi.y;
  // A hyperboloid of two sheets in two pieces; an end that is a sheet's tip gets even steps of the
  // radius.
  std::vector<std::array<double, 2>> pieces = {{low, high}};
  if (q.squares.y < 0 && q.linear.y == 0 && q.constant > 0) {
    const double tip = std::sqrt(-q.constant / q.squares.y);
    pieces = {{low, -tip}, {tip, high}};
  }
  for (const auto& [from, to] : pieces) {
    add_grid(mesh, 2 * n, n, [&, a = from, b = to](double u, double v) {
      // Finer towards a tip, where the radius grows with the root of the height.
      if (radius(a) == 0) v = v * v;
      if (radius(b) == 0) v = 1 - (1 - v) * (1 - v);
      const double y = a + (b - a) * v;
      return turned(u) * radius(y) + Vec3d{0, y, 0};
    });
    for (const double y : {from, to}) {
      if (!shape.capped || radius(y) == 0) continue;
      add_grid(mesh, 2 * n, 1, [&](double u, double v) {
        return turned(u) * (v * radius(y)) + Vec3d{0, y, 0};
      });
    }
  }
}

void add_box(Primitive& mesh, const Box3d& box, std::uint32_t n) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double end : {box.lo[axis], box.hi[axis]}) {
      const int a = (axis + 1) % 3, b = (axis + 2) % 3;
      add_grid(mesh, n, n, [&](double u, double v) {
        Vec3d p;
        p[axis] = end;
        p[a] = box.lo[a] + (box.hi[a] - box.lo[a]) * u;
        p[b] = box.lo[b] + (box.hi[b] - box.lo[b]) * v;
        return p;
      });
      if (box.lo[axis] == box.hi[axis]) return;
    }
  }
}

/// A star-shaped surface: the points where rays from the origin leave it.
void add_star(Primitive& mesh, const Shape& shape, std::uint32_t n) {
  std::vector<ShapeHit> hits;
  add_grid(mesh, 2 * n, n, [&](double u, double v) {
    const double polar = 0.5 * kTwoPi * v;
    const Vec3d direction = turned(u) * std::sin(polar) + Vec3d{0, std::cos(polar), 0};
    hits.clear();
    intersect_shape(shape, {}, direction, hits);
    for (const ShapeHit& hit : hits) {
      if (hit.t > 0) return hit.point;
    }
    return Vec3d{};
  });
}

}  // namespace

Primitive tessellated(const Shape& shape, std::uint32_t n) {
  Primitive mesh;
  switch (shape.form) {
    case Shape::Form::torus:
      add_grid(mesh, 2 * n, n, [&](double u, double v) {
        const double across = kTwoPi * v;
        return turned(u) * (shape.radius + shape.tube * std::cos(across)) +
               Vec3d{0, shape.tube * std::sin(across), 0};
      });
      break;
    case Shape::Form::terrain: {
      const Vec2d size = shape.terrain->form().size;
      add_grid(mesh, n, n, [&](double u, double v) {
        const Vec2d at = {(u - 0.5) * size.x, (v - 0.5) * size.y};
        return Vec3d{at.x, shape.terrain->height(at), at.y};
      });
      break;
    }
    case Shape::Form::blobs:
      add_star(mesh, shape, n);
      break;
    case Shape::Form::quadric:
      if (shape.quadric.squares == Vec3d{}) {
        add_box(mesh, shape.clip, n);
      } else if (!shape.latitudes && std::isinf(shape.clip.hi.x)) {
        add_round(mesh, shape, n);
      } else {
        add_star(mesh, shape, n);
      }
      break;
  }
  return mesh;
}

}  // namespace tessera::testing
