#include "tests/numeric/geometry/geometry_scenes.h"

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

Primitive soup(int count, Dice& dice) {
  Primitive p;
  while (static_cast<int>(p.triangles.size()) < count) {
    const auto first = static_cast<std::uint32_t>(p.positions.size());
    const Vec3f centre = dice.vector();
    const float size = std::exp2(-8 * dice.unit());
    for (int corner = 0; corner < 3; ++corner) {
      Vec3f offset = dice.vector() * size;
      if (dice.below(4) == 0) offset.y = 0;
      if (dice.below(8) == 0) offset = offset * Vec3f{1, 1e-4f, 1e-4f};
      p.positions.push_back(centre + offset);
    }
    if (dice.below(4) == 0) {
      for (std::uint32_t i = 0; i < 3; ++i) p.positions[first + i].z = 0.25f;
    }
    p.triangles.push_back({first, first + 1, first + 2});
    if (dice.below(6) == 0) p.triangles.push_back({first + 1, first + 2, first});
  }
  return p;
}

Primitive terrain(std::uint32_t side, Dice& dice) {
  Primitive p;
  for (std::uint32_t z = 0; z <= side; ++z) {
    for (std::uint32_t x = 0; x <= side; ++x) {
      const float scale = 2 / static_cast<float>(side);
      p.positions.push_back({static_cast<float>(x) * scale - 1,
                             dice.below(3) == 0 ? 0.0f : 0.05f * dice.unit(),
                             static_cast<float>(z) * scale - 1});
    }
  }
  add_grid_triangles(p, side);
  return p;
}

void add_grid_triangles(Primitive& primitive, std::uint32_t side) {
  for (std::uint32_t row = 0; row < side; ++row) {
    for (std::uint32_t column = 0; column < side; ++column) {
      const std::uint32_t a = row * (side + 1) + column, b = a + side + 1;
      primitive.triangles.push_back({a, a + 1, b + 1});
      primitive.triangles.push_back({a, b + 1, b});
    }
  }
}

Ray adversarial_ray(const Scene& scene, Dice& dice) {
  Ray ray;
  ray.origin = dice.vector() * 3.0f;
  ray.direction = dice.vector();
  const std::uint32_t kind = dice.below(9);
  if (kind < 3) return ray;
  const Instance& instance =
      scene.instances[dice.below(static_cast<std::uint32_t>(scene.instances.size()))];
  const Mesh& mesh = scene.meshes[static_cast<std::size_t>(instance.mesh)];
  if (mesh.primitives.empty()) return ray;
  const Primitive& primitive =
      mesh.primitives[dice.below(static_cast<std::uint32_t>(mesh.primitives.size()))];
  const auto world = [&](const Vec3f& p) {
    return Vec3f(transform_point(instance.object_to_world, Vec3d(p)));
  };
  if (mesh.shape != nullptr) {  // in its box, or along one of its axes through its centre
    const Vec3f half = mesh.shape->bounded()
                           ? (mesh.shape->bounds.hi - mesh.shape->bounds.lo) * 0.5f
                           : Vec3f{3, 0, 3};  // of a plane, a part near its origin
    const Vec3f target = world((kind < 6 ? dice.vector() : Vec3f{}) * half);
    if (kind == 8) ray.origin = world(Vec3f{0, 0, 3});
    ray.direction = target - ray.origin;
    return ray;
  }
  const Vec3f target = world(edge_or_vertex(primitive, kind % 2 == 0, dice));
  const Vec3f other = world(edge_or_vertex(primitive, true, dice));
  ray.direction = target - ray.origin;
  if (kind == 5) ray.origin = other;                             // between two surface points
  if (kind == 6) ray.origin = target - (other - target) * 4.0f;  // along a chord
  if (kind == 5 || kind == 6) ray.direction = target - ray.origin;
  if (kind >= 7) {  // in a plane of boxes: one or two zero components through a vertex
    const int axis = static_cast<int>(dice.below(3));
    ray.origin[axis] = target[axis];
    ray.direction[axis] = dice.below(2) == 0 ? 0.0f : -0.0f;
    if (kind == 8) {
      ray.origin[(axis + 1) % 3] = target[(axis + 1) % 3];
      ray.direction[(axis + 1) % 3] = 0;
    }
  }
  if (dice.below(8) == 0) ray.t_max = 2 * dice.unit();
  if (dice.below(16) == 0) ray.origin_triangle = {0, 0, dice.below(4)};
  return ray;
}

Primitive needles(int count, Dice& dice) {
  Primitive p;
  for (int i = 0; i < count; ++i) {
    const auto first = static_cast<std::uint32_t>(p.positions.size());
    const Vec3f at = dice.vector(), along = Vec3f{1, 1, 1} + dice.vector() * 0.3f;
    p.positions.insert(p.positions.end(), {at - along, at + along, at + dice.vector() * 0.05f});
    p.triangles.push_back({first, first + 1, first + 2});
  }
  return p;
}

bool same_bits(const Hit& a, const Hit& b) {
  const auto same = [](float x, float y) {
    return std::bit_cast<std::uint32_t>(x) == std::bit_cast<std::uint32_t>(y);
  };
  return same(a.t, b.t) && a.id == b.id && same(a.b0, b.b0) && same(a.b1, b.b1) && same(a.b2, b.b2);
}

}  // namespace tessera::render::testing
