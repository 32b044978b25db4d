#include "tests/numeric/geometry_scenes.h"

#include <bit>
#include <cmath>
#include <utility>

namespace tessera::render::testing {

Vec3f Dice::direction() {
  for (;;) {
    const Vec3f v = vector();
    const float square = dot(v, v);
    if (square > 0.01f && square < 1) return normalize(v);
  }
}

Primitive uv_sphere(int rows, int columns, float radius, const Vec3f& centre) {
  constexpr double kPi = 3.141592653589793;
  Primitive p;
  const Vec3d c(centre);
  p.positions.push_back(Vec3f(c + Vec3d{0, radius, 0}));
  for (int row = 1; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const double theta = kPi * row / rows, phi = 2 * kPi * column / columns;
      p.positions.push_back(Vec3f(c + Vec3d{std::sin(theta) * std::cos(phi), std::cos(theta),
                                            std::sin(theta) * std::sin(phi)} *
                                          static_cast<double>(radius)));
    }
  }
  p.positions.push_back(Vec3f(c - Vec3d{0, radius, 0}));
  const auto last = static_cast<std::uint32_t>(p.positions.size() - 1);
  const auto at = [&](int row, int column) {
    return static_cast<std::uint32_t>(1 + (row - 1) * columns + column % columns);
  };
  for (int column = 0; column < columns; ++column) {
    p.triangles.push_back({0, at(1, column + 1), at(1, column)});
    for (int row = 1; row + 1 < rows; ++row) {
      const auto a = at(row, column), b = at(row, column + 1);
      const auto d = at(row + 1, column), e = at(row + 1, column + 1);
      p.triangles.push_back({a, b, d});
      p.triangles.push_back({b, e, d});
    }
    p.triangles.push_back({at(rows - 1, column), at(rows - 1, column + 1), last});
  }
  return p;
}

Primitive quad(const Vec3f& corner, const Vec3f& a, const Vec3f& b) {
  Primitive p;
  p.positions = {corner, corner + a, corner + a + b, corner + b};
  p.triangles = {{0, 1, 2}, {0, 2, 3}};
  return p;
}

Mesh mesh_of(std::vector<Primitive> primitives) {
  Mesh mesh;
  mesh.primitives = std::move(primitives);
  return mesh;
}

void place(Scene& scene, std::int32_t mesh, const Affine3d& object_to_world) {
  Instance instance;
  instance.mesh = mesh;
  instance.object_to_world = object_to_world;
  instance.world_to_object = inverse(object_to_world).value();
  instance.flips_winding = determinant(object_to_world) < 0;
  scene.instances.push_back(instance);
}

Scene scene_of(std::vector<Primitive> primitives) {
  Scene scene;
  scene.meshes.push_back(mesh_of(std::move(primitives)));
  place(scene, 0);
  return scene;
}

ParallelFor in_order() {
  return [](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    for (std::int64_t i = 0; i < count; ++i) body(i);
  };
}

ParallelFor in_reverse() {
  return [](std::int64_t count, const std::function<void(std::int64_t)>& body) {
    for (std::int64_t i = count; i-- > 0;) body(i);
  };
}

Vec3f edge_or_vertex(const Primitive& primitive, bool edge, Dice& dice) {
  const auto& triangle =
      primitive.triangles[dice.below(static_cast<std::uint32_t>(primitive.triangles.size()))];
  const std::uint32_t corner = dice.below(3);
  const Vec3f& a = primitive.positions[triangle[corner]];
  const Vec3f& b = primitive.positions[triangle[(corner + 1) % 3]];
  return edge ? lerp(a, b, dice.unit()) : a;
}

Affine3d random_placement(Dice& dice, double scale, const Vec3d& translation, bool mirrored) {
  const Vec3d z(dice.direction());
  const Vec3d x = normalize(cross(Vec3d(dice.direction()), z));
  const Vec3d y = cross(z, x);
  Affine3d m;
  m.rows = {x * scale, y * scale, z * (mirrored ? -scale : scale)};
  m.translation = translation;
  return m;
}

bool same_bits(const Hit& a, const Hit& b) {
  const auto same = [](float x, float y) {
    return std::bit_cast<std::uint32_t>(x) == std::bit_cast<std::uint32_t>(y);
  };
  return same(a.t, b.t) && a.id == b.id && same(a.b0, b.b0) && same(a.b1, b.b1) && same(a.b2, b.b2);
}

}  // namespace tessera::render::testing
