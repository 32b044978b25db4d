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

/// Returns a closed sphere of 2 * columns * (rows - 1) triangles about `centre`, wound outwards.
Primitive uv_sphere(int rows, int columns, float radius, const Vec3f& centre = {});

/// Returns the rectangle corner, corner + a, corner + a + b, corner + b as two triangles.
Primitive quad(const Vec3f& corner, const Vec3f& a, const Vec3f& b);

Mesh mesh_of(std::vector<Primitive> primitives);

/// Adds an instance of mesh `mesh`.
void place(Scene& scene, std::int32_t mesh, const Affine3d& object_to_world = {});

/// Returns a scene of one mesh, placed by the identity.
Scene scene_of(std::vector<Primitive> primitives);

/// Run loop bodies in order or in reverse. Results must not depend on it.
ParallelFor in_order();
ParallelFor in_reverse();

/// Returns a random point of a random edge of the primitive or, if !edge, a random vertex.
Vec3f edge_or_vertex(const Primitive& primitive, bool edge, Dice& dice);

/// Returns a random rotation times `scale`, mirrored on request, followed by `translation`.
Affine3d random_placement(Dice& dice, double scale, const Vec3d& translation, bool mirrored);

/// Returns random triangles of mixed sizes; some are axis-parallel, some needles, some duplicates.
Primitive soup(int count, Dice& dice);

/// Returns a height field on a grid, with many shared planes, edges and vertices.
Primitive terrain(std::uint32_t side, Dice& dice);

/// Adds the triangles, two for each cell, of a grid of (side + 1)^2 positions, row by row.
void add_grid_triangles(Primitive& primitive, std::uint32_t side);

/// Returns long, thin, slanted triangles that cross each other, so that the builder splits them.
Primitive needles(int count, Dice& dice);

/// Returns a random ray (one in three) or one through an edge, through a vertex or in an axis
/// plane.
Ray adversarial_ray(const Scene& scene, Dice& dice);

/// Returns whether two hits have the same bits.
bool same_bits(const Hit& a, const Hit& b);

}  // namespace tessera::render::testing
