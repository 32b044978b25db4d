// Hard case 21: CSG operands with coincident faces, and thin walls, which must not be taken for
// such.

#include <gtest/gtest.h>

#include <array>
#include <string>

#include "tests/numeric/shapes/solid_scenes.h"
#include "worker/geometry/surface_point.h"

namespace tessera::render::testing {
namespace {

/// How a cube is made.
enum class Make {
  shape,   // box, placed by its node
  mesh,    // twelve triangles, placed by their node
  scaled,  // three times as large, placed by a node with the scale 1/3
  baked,   // twelve triangles whose vertices are in the solid's space
};
constexpr std::array kMakes = {Make::shape, Make::mesh, Make::scaled, Make::baked};

/// Adds the cube [-half, half]^3, placed by `at` in the solid's space.
void add_cube(Scene& scene, Make make, double half, const Affine3d& solid, const Affine3d& at) {
  if (make == Make::shape) {
    place_shape(scene, make_box({2 * half, 2 * half, 2 * half}), solid * at);
    return;
  }
  const double size = make == Make::scaled ? 3 : 1;
  const Affine3d baked = make == Make::baked ? at : Affine3d{};
  scene.meshes.push_back(mesh_of({cube(half * size, baked)}));
  place(scene, static_cast<std::int32_t>(scene.meshes.size()) - 1,
        make == Make::baked ? solid : solid * at * scaled(Vec3d{1, 1, 1} * (1 / size)));
}

/// A solid's space: its scale and offset and a random rotation.
struct Space {
  double scale, offset;
};
constexpr std::array<Space, 7> kSpaces = {
    {{1, 0}, {1e-3, 0}, {1e3, 0}, {1, 1e3}, {1, 1e5}, {1e3, 1e5}, {1e-3, 10}}};

/// Rays that hit few edges: a random line through the ball of this radius, in the solid's space.
Ray random_ray(const Affine3d& solid, double radius, Dice& dice) {
  const Vec3d from = Vec3d(dice.direction()) * 5.0;
  const Vec3d to = Vec3d(dice.vector()) * radius;
  Ray ray;
  ray.origin = Vec3f(transform_point(solid, from));
  ray.direction = Vec3f(transform_vector(solid, to - from));
  return ray;
}

/// Calls test(solid's space, how the first and second cube are made, dice) for all combinations in
/// which one is a mesh.
template <typename Test>
void for_all_pairs(const Test& test) {
  Dice dice(21);
  for (const Space& space : kSpaces) {
    for (const Make first : kMakes) {
      for (const Make second : kMakes) {
        SCOPED_TRACE("scale " + std::to_string(space.scale) + ", offset " +
                     std::to_string(space.offset) + ", made " +
                     std::to_string(static_cast<int>(first)) + " and " +
                     std::to_string(static_cast<int>(second)));
        const Vec3d offset = Vec3d{0.7, -0.4, 1} * space.offset;
        test(random_placement(dice, space.scale, offset, false), first, second, dice);
      }
    }
  }
}

/// Two equal cubes, the second moved by its size along z so that they share a face.
Scene stacked(CsgOperation operation, const Affine3d& solid, Make first, Make second) {
  Scene scene;
  const double half = 0.35;
  add_cube(scene, first, half, solid, moved({0.1, 0.2, -half}));
  add_cube(scene, second, half, solid, moved({0.1, 0.2, half}));
  combine(scene, operation);
  return scene;
}

constexpr int kRays = 400;

/// Number of random rays that hit a scene more than `expected` times.
int rays_with_more_hits(const Scene& scene, std::size_t expected, const Affine3d& solid,
                        Dice& dice) {
  int rays = 0;
  for (int i = 0; i < kRays; ++i) {
    rays += all_hits(scene, random_ray(solid, 0.5, dice)).size() > expected ? 1 : 0;
  }
  return rays;
}

TEST(CoincidentFaces, CubeXorItselfIsEmpty) {
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    Scene scene;
    const Affine3d turned = random_placement(dice, 0.9, {0.3, 0.1, 0.2}, false);
    add_cube(scene, first, 0.35, solid, turned);
    add_cube(scene, second, 0.35, solid, turned);
    combine(scene, CsgOperation::exclude);
    EXPECT_EQ(rays_with_more_hits(scene, 0, solid, dice), 0);
  });
}

TEST(CoincidentFaces, UnionHasNoInnerFace) {
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    const Scene scene = stacked(CsgOperation::unite, solid, first, second);
    EXPECT_EQ(rays_with_more_hits(scene, 2, solid, dice), 0);
  });
}

TEST(CoincidentFaces, IntersectionOfNeighboursIsEmpty) {
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    const Scene scene = stacked(CsgOperation::intersect, solid, first, second);
    EXPECT_EQ(rays_with_more_hits(scene, 0, solid, dice), 0);
  });
}

TEST(CoincidentFaces, HoleWithCommonFaceIsOpen) {
  // From above through the common face z = 0.6 to the floor of the hole at z = 0.
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    Scene scene;
    add_cube(scene, first, 0.6, solid, {});
    add_cube(scene, second, 0.3, solid, moved({0, 0, 0.3}));
    combine(scene, CsgOperation::subtract);
    int films = 0;
    for (int i = 0; i < kRays; ++i) {
      const Vec3d from = {0.2 * dice.both(), 0.2 * dice.both(), 3};
      const Vec3d to = {0.2 * dice.both(), 0.2 * dice.both(), 0};
      Ray ray;
      ray.origin = Vec3f(transform_point(solid, from));
      ray.direction = Vec3f(transform_vector(solid, to - from));
      const std::vector<Hit> hits = all_hits(scene, ray);
      films += hits.size() == 2 && std::fabs(hits[0].t - 1) < 0.01 ? 0 : 1;
    }
    EXPECT_EQ(films, 0);
  });
}

TEST(CoincidentFaces, VerdictIsIndependentOfOrder) {
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    for (const CsgOperation operation :
         {CsgOperation::unite, CsgOperation::intersect, CsgOperation::exclude}) {
      Scene forth, back;
      add_cube(forth, first, 0.4, solid, moved({0.1, 0, 0}));
      add_cube(forth, second, 0.3, solid, moved({0.2, 0, 0}));
      add_cube(back, second, 0.3, solid, moved({0.2, 0, 0}));
      add_cube(back, first, 0.4, solid, moved({0.1, 0, 0}));
      combine(forth, operation);
      combine(back, operation);
      int differences = 0;
      for (int i = 0; i < kRays / 4; ++i) {
        const Ray ray = random_ray(solid, 0.5, dice);
        differences += all_hits(forth, ray).size() == all_hits(back, ray).size() ? 0 : 1;
      }
      EXPECT_EQ(differences, 0);
    }
  });
}

TEST(CoincidentFaces, NestedSolidsLeaveNoFilm) {
  // (A without B) with B is A: its complement in A is empty.
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    Scene scene;
    add_cube(scene, first, 0.6, solid, {});
    add_cube(scene, second, 0.3, solid, moved({0, 0, 0.3}));
    add_cube(scene, first, 0.3, solid, moved({0, 0, 0.3}));
    add_cube(scene, second, 0.6, solid, {});
    combine(scene, CsgOperation::exclude);
    scene.solids[0].steps = {{true, {}, 0},
                             {true, {}, 1},
                             {false, CsgOperation::subtract, 2},
                             {true, {}, 2},
                             {false, CsgOperation::unite, 2},
                             {true, {}, 3},
                             {false, CsgOperation::exclude, 2}};
    EXPECT_EQ(rays_with_more_hits(scene, 0, solid, dice), 0);
  });
}

TEST(CoincidentFaces, MovingCubeXorItselfIsEmpty) {
  Dice dice(22);
  for (const Make first : kMakes) {
    for (const Make second : kMakes) {
      Scene scene;
      const Affine3d solid = random_placement(dice, 1, {}, false);
      add_cube(scene, first, 0.35, solid, moved({0.1, 0, 0.2}));
      add_cube(scene, second, 0.35, solid, moved({0.1, 0, 0.2}));
      combine(scene, CsgOperation::exclude);
      scene.key_times = {0, 0.3f, 1};
      const Affine3d step = random_placement(dice, 1, {0.1, 0.2, 0.3}, false);
      for (Instance& instance : scene.instances) {
        instance.motion = static_cast<std::int32_t>(scene.motions.size());
        const Affine3d& start = instance.object_to_world;
        scene.motions.push_back({start, step * start, step * step * start});
      }
      int films = 0;
      for (int i = 0; i < kRays; ++i) {
        Ray ray = random_ray({}, 0.8, dice);
        ray.time = dice.unit();
        films += all_hits(scene, ray).empty() ? 0 : 1;
      }
      EXPECT_EQ(films, 0);
    }
  }
}

TEST(CoincidentFaces, TurnedMeshXorItselfIsEmpty) {
  // The same sphere of triangles, turned by its node or by its vertices.
  Dice dice(23);
  for (const Space& space : kSpaces) {
    const Affine3d solid =
        random_placement(dice, space.scale, Vec3d{1, 0, 2} * space.offset, false);
    const Affine3d turned = random_placement(dice, 0.8, {0.1, 0.1, 0}, false);
    Primitive sphere = uv_sphere(8, 12, 1);
    Scene scene;
    scene.meshes.push_back(mesh_of({sphere}));
    for (Vec3f& p : sphere.positions) p = Vec3f(transform_point(turned, Vec3d(p)));
    scene.meshes.push_back(mesh_of({sphere}));
    place(scene, 0, solid * turned);
    place(scene, 1, solid);
    combine(scene, CsgOperation::exclude);
    int films = 0;
    for (int i = 0; i < kRays; ++i) {
      films += all_hits(scene, random_ray(solid, 0.8, dice)).empty() ? 0 : 1;
    }
    EXPECT_EQ(films, 0) << "scale " << space.scale << ", offset " << space.offset;
  }
}

/// Starts a ray on a hit on the mesh of instance 0, towards the side of `direction`.
Ray leave(const Scene& scene, const Hit& hit, const Vec3f& direction) {
  const Instance& instance = scene.instances[0];
  const Primitive& mesh = scene.meshes[0].primitives[0];
  const auto [a, b, c] = mesh.triangles[hit.id.triangle];
  const PlacedTriangle triangle = {instance.object_to_world, instance.world_to_object,
                                   mesh.positions[a], mesh.positions[b], mesh.positions[c]};
  return spawn_ray(surface_point(triangle, hit.b1, hit.b2), hit.id, direction);
}

/// Shoots rays at the common plane x = 0.65 of a small cube (instance 0) and a larger one, and from
/// there to both sides. Returns how many do not see one entry, nothing outside, and one exit
/// inside.
int wrong_rays(const Scene& scene, const Affine3d& solid, Dice& dice) {
  int wrong = 0;
  for (int i = 0; i < kRays; ++i) {
    const Vec3d target = {0.65, 0.3 * dice.both(), 0.3 * dice.both()};
    Ray ray;
    ray.origin = Vec3f(transform_point(solid, target + Vec3d{2, 0, 0}));
    ray.direction = Vec3f(transform_vector(solid, Vec3d{-1, 0, 0}));
    const std::vector<Hit> hits = all_hits(scene, ray);
    if (hits.size() != 2 || hits[0].id.instance != 0) {
      ++wrong;
      continue;
    }
    const Vec3d side = {1, 2 * dice.both(), 2 * dice.both()};
    const Vec3f away(transform_vector(solid, side));
    wrong += all_hits(scene, leave(scene, hits[0], away)).empty() ? 0 : 1;
    wrong += all_hits(scene, leave(scene, hits[0], -away)).size() == 1 ? 0 : 1;
  }
  return wrong;
}

TEST(CoincidentFaces, RayFromCommonFaceIgnoresOther) {
  for_all_pairs([](const Affine3d& solid, Make first, Make second, Dice& dice) {
    if (first == Make::shape) return;
    Scene scene;
    add_cube(scene, first, 0.35, solid, moved({0.3, 0, 0}));
    add_cube(scene, second, 0.4, solid, moved({0.25, 0.05, 0}));
    combine(scene, CsgOperation::unite);
    EXPECT_EQ(wrong_rays(scene, solid, dice), 0);
  });
}

TEST(CoincidentFaces, RayFromFaceIgnoresInexactFace) {
  // The vertices of the large cube are rounded by more than the ray's origin is moved off the face.
  Dice dice(26);
  for (int trial = 0; trial < 10; ++trial) {
    const Affine3d turned = random_placement(dice, 1, {}, false);
    Scene scene;
    add_cube(scene, Make::mesh, 0.35, turned, moved({0.3, 0, 0}));
    add_cube(scene, Make::baked, 300, {}, turned * moved({0.65 - 300, 0, 0}));
    combine(scene, CsgOperation::unite);
    EXPECT_EQ(wrong_rays(scene, turned, dice), 0);
  }
}

/// Rays from this distance that meet a shell of radius 1 almost perpendicularly; returns how many
/// do not cross both walls.
int broken_walls(const Scene& scene, double distance) {
  Dice dice(24);
  int broken = 0;
  for (int i = 0; i < kRays; ++i) {
    const Vec3d from(dice.direction());
    Ray ray;
    ray.origin = Vec3f(from * distance);
    ray.direction = Vec3f(Vec3d(dice.vector()) * 0.3 - Vec3d(ray.origin));
    const std::vector<Hit> hits = all_hits(scene, ray);
    const bool ordered = std::is_sorted(hits.begin(), hits.end(), [](const Hit& a, const Hit& b) {
      return a.t <= b.t;  // strictly increasing
    });
    const bool whole = hits.size() == 4 && hits[0].id.instance == 0 && hits[1].id.instance == 1 &&
                       hits[2].id.instance == 1 && hits[3].id.instance == 0;
    broken += whole && ordered ? 0 : 1;
  }
  return broken;
}

TEST(ThinWalls, ShellOfShapesIsClosed) {
  for (const double distance : {3.0, 1e3, 1e5}) {
    for (const double thickness : {1e-2, 3e-5, 1e-7, 4e-13 * distance}) {
      Scene scene;
      place_shape(scene, make_ellipsoid({1, 1, 1}));
      place_shape(scene, make_ellipsoid(Vec3d{1, 1, 1} * (1 - thickness)));
      combine(scene, CsgOperation::subtract);
      EXPECT_EQ(broken_walls(scene, distance), 0) << thickness << " at " << distance;
    }
  }
}

TEST(ThinWalls, ShellOfMeshesIsClosed) {
  for (const double distance : {3.0, 1e3}) {
    for (const double thickness : {1e-2, 3e-5, 2e-6}) {
      Scene scene;
      scene.meshes.push_back(mesh_of({uv_sphere(16, 24, 1)}));
      place(scene, 0);
      place(scene, 0, scaled(Vec3d{1, 1, 1} * (1 - thickness)));
      combine(scene, CsgOperation::subtract);
      EXPECT_EQ(broken_walls(scene, distance), 0) << thickness << " at " << distance;
    }
  }
}

TEST(ThinWalls, WallWithinOneMeshIsClosed) {
  // Both sides of the wall belong to one operand, which is as thin as floats allow.
  Primitive plate = cube(1);
  for (Vec3f& p : plate.positions) p.z = p.z > 0 ? 1 + 0x1p-23f : 1;
  Scene scene;
  scene.meshes.push_back(mesh_of({plate}));
  place(scene, 0);
  place_shape(scene, make_box({0.5, 0.5, 0.5}), moved({0, 0, -4}));
  combine(scene, CsgOperation::unite);
  Ray ray;
  ray.origin = {0.1f, 0.3f, 900};
  ray.direction = {0, 0.6f, -899};
  EXPECT_EQ(all_hits(scene, ray).size(), 2u);
}

}  // namespace
}  // namespace tessera::render::testing
