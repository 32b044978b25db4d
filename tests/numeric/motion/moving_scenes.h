#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "tests/numeric/shapes/solid_scenes.h"

namespace tessera::render::testing {

/// Gives the instance a random placement for each key, near the one before.
inline void move(Scene& scene, std::uint32_t instance, Dice& dice, double stride) {
  scene.instances[instance].motion = static_cast<std::int32_t>(scene.motions.size());
  std::vector<Affine3d>& motion = scene.motions.emplace_back();
  Affine3d at = scene.instances[instance].object_to_world;
  for (std::size_t k = 0; k < scene.key_times.size(); ++k) {
    motion.push_back(at);
    for (Vec3d& row : at.rows) row += Vec3d(dice.vector()) * (stride * length(row));
    at.translation += Vec3d(dice.vector()) * stride;
  }
}

/// Gives the mesh other vertices for each key.
inline void bend(Scene& scene, std::size_t mesh, Dice& dice, float stride) {
  SharedArray<Primitive> shape = scene.meshes[mesh].primitives;
  for (std::size_t k = 0; k < scene.key_times.size(); ++k) {
    std::vector<Primitive> next(shape.begin(), shape.end());
    for (Primitive& p : next) {
      for (Vec3f& v : p.positions) v += dice.vector() * stride;
    }
    shape = std::move(next);
    scene.meshes[mesh].keys.push_back(shape);
  }
}

/// Meshes, shapes and a CSG solid, some moving and some static.
inline Scene moving_scene(Dice& dice) {
  Scene scene;
  scene.key_times = {0, 0.125f, 0.5f, 0.5f + 0x1p-24f, 1};
  scene.meshes = {mesh_of({soup(20, dice), soup(10, dice)}), mesh_of({uv_sphere(4, 6, 1)}),
                  mesh_of({soup(40, dice)}), mesh_of({uv_sphere(4, 6, 0.5f)})};
  const auto somewhere = [&] {
    return random_placement(dice, std::exp2(-3 * dice.unit()), Vec3d(dice.vector()),
                            dice.below(2) == 0);
  };
  for (std::int32_t i = 0; i < 12; ++i) place(scene, i % 2, somewhere());
  for (std::uint32_t i = 0; i < 8; ++i) move(scene, i, dice, i < 4 ? 0.1 : 0.7);
  place(scene, 2);  // changes where it is
  place(scene, 2, somewhere());
  move(scene, 13, dice, 0.2);
  place(scene, 3, somewhere());
  bend(scene, 2, dice, 0.1f);
  bend(scene, 3, dice, 0.02f);
  const std::uint32_t ball = place_shape(scene, make_ellipsoid({0.3, 0.3, 0.3}), somewhere());
  move(scene, ball, dice, 0.3);
  place_shape(scene, make_torus(0.5, 0.2), somewhere());
  const std::uint32_t first = place_shape(scene, make_box({1, 1, 1}), somewhere());
  place_shape(scene, make_ellipsoid({0.6, 0.6, 0.6}), scene.instances[first].object_to_world);
  place(scene, 1, scene.instances[first].object_to_world);
  combine(scene, CsgOperation::subtract, first);
  move(scene, first + 1, dice, 0.2);
  move(scene, first + 2, dice, 0.1);
  return scene;
}

}  // namespace tessera::render::testing
