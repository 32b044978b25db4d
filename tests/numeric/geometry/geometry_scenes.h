#pragma once

#include <cstdint>
#include <random>

#include "worker/accel/scene_accel.h"
#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"

namespace tessera::render::testing {

/// Random numbers with a fixed seed for geometry tests.
class Dice {
 public:
  explicit Dice(std::uint32_t seed) : random_(seed) {}
  /// A multiple of 2^-24 in [0, 1).
  float unit() { return static_cast<float>(random_() >> 8) * 0x1p-24f; }
  /// In [-1, 1).
  float both() { return 2 * unit() - 1; }
  Vec3f vector() {
    const float x = both(), y = both();
    return {x, y, both()};
  }
  /// Uniform on the unit sphere, in double.
  Vec3f direction();
  std::uint32_t below(std::uint32_t n) { return random_() % n; }

 private:
  std::mt19937 random_;
};

/// A closed sphere of 2 * columns * (rows - 1) triangles about `centre`, wound outwards.
Primitive uv_sphere(int rows, int columns, float radius, const Vec3f& centre = {});

/// The rectangle corner, corner + a, corner + a + b, corner + b as two triangles.
Primitive quad(const Vec3f& corner, const Vec3f& a, const Vec3f& b);

Mesh mesh_of(std::vector<Primitive> primitives);

/// Adds an instance of mesh `mesh`.
void place(Scene& scene, std::int32_t mesh, const Affine3d& object_to_world = {});

/// A scene of one mesh, placed by the identity.
Scene scene_of(std::vector<Primitive> primitives);

/// Runs loop bodies in order, or in reverse; results must not differ.
ParallelFor in_order();
ParallelFor in_reverse();

/// A random point of a random edge of the primitive, or (edge = false) a random vertex.
Vec3f edge_or_vertex(const Primitive& primitive, bool edge, Dice& dice);

/// Rotation about a random axis times `scale`, then `translation`; mirrored if asked.
Affine3d random_placement(Dice& dice, double scale, const Vec3d& translation, bool mirrored);

/// Random triangles of mixed sizes; some flat along an axis, some needles, some duplicated.
Primitive soup(int count, Dice& dice);

/// A height field on a grid: many shared planes, edges and vertices.
Primitive terrain(std::uint32_t side, Dice& dice);

/// Long thin slanted triangles that cross each other, for which spatial splits are made.
Primitive needles(int count, Dice& dice);

/// A random ray (one in three), or one along an edge, through a vertex or in an axis plane.
Ray adversarial_ray(const Scene& scene, Dice& dice);

/// Whether two hits have the same bits.
bool same_bits(const Hit& a, const Hit& b);

}  // namespace tessera::render::testing
