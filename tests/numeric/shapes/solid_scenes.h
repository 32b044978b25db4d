#pragma once

#include <algorithm>
#include <memory>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/make_shape.h"

namespace tessera::render::testing {

inline Affine3d moved(const Vec3d& by) {
  Affine3d m;
  m.translation = by;
  return m;
}

inline Affine3d scaled(const Vec3d& by) {
  Affine3d m;
  for (int k = 0; k < 3; ++k) m.rows[static_cast<std::size_t>(k)][k] = by[k];
  return m;
}

inline Shape ball(double radius) {
  return make_ellipsoid({radius, radius, radius});
}

inline std::vector<ShapeHit> hits_of(const Shape& shape, const Vec3d& origin,
                                     const Vec3d& direction) {
  std::vector<ShapeHit> hits;
  intersect_shape(shape, origin, direction, hits);
  return hits;
}

/// Adds an instance of a shape; returns its index.
inline std::uint32_t place_shape(Scene& scene, const Shape& shape, const Affine3d& at = {}) {
  Mesh mesh = mesh_of({Primitive{}});
  mesh.shape = std::make_shared<const Shape>(shape);
  scene.meshes.push_back(std::move(mesh));
  place(scene, static_cast<std::int32_t>(scene.meshes.size()) - 1, at);
  return static_cast<std::uint32_t>(scene.instances.size()) - 1;
}

inline Scene shape_scene(const Shape& shape, const Affine3d& at = {}) {
  Scene scene;
  place_shape(scene, shape, at);
  return scene;
}

/// Makes one solid of all instances from `first` on.
inline void combine(Scene& scene, CsgOperation operation, std::uint32_t first = 0) {
  CsgSolid solid;
  solid.first = first;
  for (auto i = first; i < scene.instances.size(); ++i) {
    scene.instances[i].operand = true;
    solid.steps.push_back({true, operation, solid.count++});
  }
  solid.steps.push_back({false, operation, solid.count});
  scene.solids.push_back(solid);
}

/// The cube [-half, half]^3 of twelve triangles, wound outwards.
inline Primitive cube(double half, const Affine3d& baked = {}) {
  Primitive out;
  for (std::uint32_t i = 0; i < 8; ++i) {
    const Vec3d corner = {(i & 1) != 0 ? half : -half, (i & 2) != 0 ? half : -half,
                          (i & 4) != 0 ? half : -half};
    out.positions.push_back(Vec3f(transform_point(baked, corner)));
  }
  out.triangles = {{0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}, {0, 1, 5}, {0, 5, 4},
                   {2, 6, 7}, {2, 7, 3}, {0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}};
  return out;
}

/// All hits by brute force, in order.
inline std::vector<Hit> all_hits(const Scene& scene, const Ray& ray) {
  std::vector<Hit> hits;
  brute_force_hits(scene, ray, [&](const Hit& hit) { hits.push_back(hit); });
  std::sort(hits.begin(), hits.end(), precedes);
  return hits;
}

}  // namespace tessera::render::testing
