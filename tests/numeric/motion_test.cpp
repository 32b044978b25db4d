/// Motion blur: what moves while the shutter is open. Hits first (hard case 31), then pictures.
#include "worker/geometry/motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/numeric/geometry_scenes.h"
#include "tests/numeric/solid_scenes.h"
#include "tests/support/gltf_builder.h"
#include "tests/support/memory_scene.h"
#include "tests/support/plain_scene.h"
#include "worker/accel/brute_force.h"
#include "worker/accel/reference/reference_accel.h"
#include "worker/scene/loader.h"
#include "worker/scene/needs.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;
using tessera::testing::Picture;
using tessera::testing::render_picture;
using tessera::testing::small_settings;

constexpr double kPi = 3.14159265358979323846;

TEST(Between, NeverLeavesItsEndsAndIsExactWhereTheyAgree) {
  Dice dice(1);
  for (int i = 0; i < 1'000'000; ++i) {
    const float a = dice.both() * std::exp2(static_cast<float>(dice.below(40)) - 20);
    const float b = dice.below(4) == 0 ? a : dice.both();
    const float v = between(a, b, dice.below(8) == 0 ? 1.0f : dice.unit());
    ASSERT_GE(v, std::min(a, b));
    ASSERT_LE(v, std::max(a, b));
  }
}

TEST(FindKey, GivesTheSegmentOfEveryTime) {
  const std::vector<float> times = {0, 0.25f, 0.25f + 0x1p-24f, 0.5f, 1};
  for (std::uint32_t k = 0; k + 1 < times.size(); ++k) {
    EXPECT_EQ(find_key(times, times[k]).segment, k);
    EXPECT_EQ(find_key(times, times[k]).f, 0);
  }
  EXPECT_EQ(find_key(times, 0.75f).segment, 3u);
  EXPECT_EQ(find_key(times, 0.75f).f, 0.5f);
  EXPECT_EQ(find_key(times, 1).f, 1);
}

/// Gives the instance a way to go: random places by key, each near the last.
void move(Scene& scene, std::uint32_t instance, Dice& dice, double stride) {
  scene.instances[instance].motion = static_cast<std::int32_t>(scene.motions.size());
  std::vector<Affine3d>& motion = scene.motions.emplace_back();
  Affine3d at = scene.instances[instance].object_to_world;
  for (std::size_t k = 0; k < scene.key_times.size(); ++k) {
    motion.push_back(at);
    for (Vec3d& row : at.rows) row += Vec3d(dice.vector()) * (stride * length(row));
    at.translation += Vec3d(dice.vector()) * stride;
  }
}

/// Gives the mesh other vertices at each key.
void bend(Scene& scene, std::size_t mesh, Dice& dice, float stride) {
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

/// Meshes, shapes and a CSG solid, of each some that move and some that do not.
Scene moving_scene(Dice& dice) {
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

/// The scene as it stands at a time, for rays that mean something.
Scene at_time(const Scene& scene, float time) {
  Scene now = scene;
  const KeyPlace at = find_key(scene.key_times, time);
  for (Instance& instance : now.instances) {
    if (instance.motion == kNone) continue;
    const auto pose = pose_at(scene.motions[static_cast<std::size_t>(instance.motion)], at);
    if (pose) instance.object_to_world = pose->object_to_world;
  }
  for (Mesh& mesh : now.meshes) {
    if (mesh.keys.empty()) continue;
    std::vector<Primitive> primitives(mesh.primitives.begin(), mesh.primitives.end());
    for (std::size_t p = 0; p < primitives.size(); ++p) {
      for (std::size_t v = 0; v < primitives[p].positions.size(); ++v) {
        primitives[p].positions[v] = between(mesh.keys[at.segment][p].positions[v],
                                             mesh.keys[at.segment + 1][p].positions[v], at.f);
      }
    }
    mesh.primitives = std::move(primitives);
  }
  return now;
}

/// Rays at many times, with what brute force finds.
struct Shots {
  std::vector<Ray> rays;
  std::vector<bool> found;
  std::vector<Hit> hits;
  int count = 0, moving = 0;
};

Shots shoot(const Scene& scene, int times, int rays, Dice& dice) {
  Shots out;
  for (int i = 0; i < times; ++i) {
    const std::uint32_t kind = dice.below(6);
    const float time =
        kind == 0 ? scene.key_times[dice.below(static_cast<std::uint32_t>(scene.key_times.size()))]
        : kind == 1 ? 0.5f + 0x1p-24f * dice.unit()
                    : dice.unit();
    const Scene now = at_time(scene, time);
    for (int k = 0; k < rays; ++k) {
      Ray ray = adversarial_ray(now, dice);
      ray.time = time;
      if (dice.below(8) == 0) ray.leaves = {dice.below(12), dice.below(2), dice.below(10)};
      Hit hit;
      out.rays.push_back(ray);
      out.found.push_back(brute_force_closest(scene, ray, hit));
      out.hits.push_back(hit);
      if (!out.found.back()) continue;
      ++out.count;
      const Instance& instance = scene.instances[hit.id.instance];
      const bool moves = instance.motion != kNone ||
                         !scene.meshes[static_cast<std::size_t>(instance.mesh)].keys.empty();
      out.moving += moves ? 1 : 0;
    }
  }
  return out;
}

template <typename Accel>
int mismatches(const Accel& accel, const Shots& shots) {
  int wrong = 0;
  for (std::size_t i = 0; i < shots.rays.size(); ++i) {
    Hit hit;
    const bool found = accel.closest_hit(shots.rays[i], hit);
    if (found != shots.found[i] || (found && !same_bits(hit, shots.hits[i]))) ++wrong;
    if (accel.any_hit(shots.rays[i]) != shots.found[i]) ++wrong;
    Hit filtered;
    const auto odd = [](const Hit& h) { return h.id.triangle % 2 == 1; };
    const bool any_odd = accel.any_hit(shots.rays[i], odd);
    if (accel.closest_hit(shots.rays[i], filtered, odd) != any_odd) ++wrong;
    if (any_odd && found && precedes(filtered, hit)) ++wrong;
  }
  return wrong;
}

/// A reference structure with the calls of SceneAccel.
struct Reference {
  reference::ReferenceAccel accel;
  bool closest_hit(const Ray& ray, Hit& hit) const { return accel.closest_hit(ray, nullptr, hit); }
  template <typename F>
  bool closest_hit(const Ray& ray, Hit& hit, F&& f) const {
    const HitFilter filter(f);
    return accel.closest_hit(ray, &filter, hit);
  }
  bool any_hit(const Ray& ray) const { return accel.any_hit(ray, nullptr); }
  template <typename F>
  bool any_hit(const Ray& ray, F&& f) const {
    const HitFilter filter(f);
    return accel.any_hit(ray, &filter);
  }
};

TEST(HardCase31, EveryStructureFindsTheSameMovingHits) {
  Dice dice(31);
  const Scene scene = moving_scene(dice);
  const Shots shots = shoot(scene, 60, 60, dice);
  EXPECT_GT(shots.count, 1'800);
  EXPECT_GT(shots.moving, 1'000);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    const SceneAccel accel(scene, in_order(), isa);
    EXPECT_FALSE(accel.takes_packets());
    EXPECT_EQ(mismatches(accel, shots), 0);
  }
  for (const reference::Structure& structure : reference::structures()) {
    const Reference accel{reference::ReferenceAccel(scene, structure)};
    EXPECT_EQ(mismatches(accel, shots), 0) << structure.name;
  }
}

/// Where the world boxes matter most: thin things far from their origins that turn fast.
Scene turning_things(Dice& dice) {
  Scene scene;
  scene.key_times = {0, 1};
  scene.meshes = {mesh_of({uv_sphere(3, 4, 0.01f, {1, 0, 0})})};
  for (int i = 0; i < 40; ++i) {
    place(scene, 0, random_placement(dice, 1, Vec3d(dice.vector()), false));
    // By any angle up to half a turn, where it shrinks to nothing on the way.
    scene.instances.back().motion = i;
    const Affine3d all = random_placement(dice, 1, Vec3d(dice.vector()), i % 3 == 0);
    const Affine3d turn = between(Affine3d{}, all, i % 4 == 0 ? 1 : 0.3f * dice.unit());
    const Affine3d& from = scene.instances.back().object_to_world;
    scene.motions.push_back({from, from * turn});
  }
  return scene;
}

TEST(HardCase31, BoxesHoldWhatTurnsBetweenTheirEnds) {
  Dice dice(32);
  const Scene scene = turning_things(dice);
  const Shots shots = shoot(scene, 100, 40, dice);
  EXPECT_GT(shots.moving, 1'500);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    EXPECT_EQ(mismatches(SceneAccel(scene, in_order(), isa), shots), 0);
  }
}

/// A point of a placed mesh as far out along an axis as any, but for a little: 2e-4 of a triangle.
Vec3d outermost(const Primitive& p, const Affine3d& placed, int axis, double side) {
  Vec3d best, found;
  bool any = false;
  for (const auto& triangle : p.triangles) {
    std::array<Vec3d, 3> corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = transform_point(placed, Vec3d(p.positions[triangle[k]]));
    }
    const Vec3d middle = (corners[0] + corners[1] + corners[2]) / 3.0;
    for (const Vec3d& corner : corners) {
      if (any && side * corner[axis] <= side * best[axis]) continue;
      any = true;
      best = corner;
      found = corner + (middle - corner) * 2e-4;
    }
  }
  return found;
}

/// Rays along the faces of the boxes, just inside, when what moves touches them: at keys.
TEST(HardCase31, BoxesReachAsFarAsWhatIsInThem) {
  Dice dice(33);
  const Scene scene = turning_things(dice);
  Shots shots;
  for (std::size_t i = 0; i < scene.instances.size() * 12; ++i) {
    const std::size_t instance = i / 12, key = i % 2;
    const int axis = static_cast<int>(i % 3);
    const Vec3d at = outermost(scene.meshes[0].primitives[0], scene.motions[instance][key], axis,
                               i % 12 < 6 ? -1 : 1);
    Vec3d along(dice.direction());
    along[axis] = 0;
    Ray ray;
    ray.origin = Vec3f(at - along);
    ray.direction = Vec3f(along);
    ray.time = scene.key_times[key];
    Hit hit;
    shots.rays.push_back(ray);
    shots.found.push_back(brute_force_closest(scene, ray, hit));
    shots.hits.push_back(hit);
    shots.count += shots.found.back() ? 1 : 0;
  }
  EXPECT_GT(shots.count, 300);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    EXPECT_EQ(mismatches(SceneAccel(scene, in_order(), isa), shots), 0);
  }
}

// ---------------------------------------------------------------------------- from files

std::string number(int n) {
  return std::to_string(n);
}

/// Animates `path` of a node from 0 s to the last of `times`.
void animate(GltfBuilder& file, int node, const std::string& path, const std::vector<float>& times,
             const char* type, const std::vector<float>& values,
             const std::string& interpolation = "LINEAR") {
  const int input = file.add_floats("SCALAR", times), output = file.add_floats(type, values);
  file.add("animations", R"({"samplers": [{"input": )" + number(input) + R"(, "output": )" +
                             number(output) + R"(, "interpolation": ")" + interpolation +
                             R"("}], "channels": [{"sampler": 0, "target": {"node": )" +
                             number(node) + R"(, "path": ")" + path + R"("}}]})");
}

contract::RenderSettings all_animations() {
  contract::RenderSettings settings = small_settings(24, 1, 4);
  settings.animation = "all";
  return settings;
}

/// A camera at z = 5, whose shutter is open from `open` to `close` if these differ.
int add_camera(GltfBuilder& file, double open, double close) {
  std::string extension;
  if (open < close) {
    file.use_extension("TESSERA_camera");
    extension = R"(, "extensions": {"TESSERA_camera": {"shutter": {"open": )" +
                std::to_string(open) + R"(, "close": )" + std::to_string(close) + "}}}";
  }
  file.add("cameras", R"({"type": "perspective", "perspective": {"yfov": 0.025, "znear": 0.01})" +
                          extension + "}");
  return file.add_node(R"({"camera": 0, "translation": [0, 0, 5]})");
}

/// The catalogue's own: a ball of radius 0.1, 1 m from the z axis, which it goes half round.
TEST(HardCase31, ABallThatGoesHalfRoundIsHitAtTheTop) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  file.use_extension("TESSERA_shape");
  const int ball = file.add_node(
      R"({"translation": [1, 0, 0], "extensions": {"TESSERA_shape": {"type": "sphere", "radius": 0.1}}})",
      false);
  const Primitive sphere = uv_sphere(8, 12, 0.1f);
  tessera::testing::TriangleMesh triangles;
  triangles.positions = sphere.positions;
  for (const auto& t : sphere.triangles) {
    triangles.indices.insert(triangles.indices.end(), t.begin(), t.end());
  }
  const int mesh = file.add_node(
      R"({"translation": [1, 0, 1], "mesh": )" + number(file.add_mesh(triangles)) + "}", false);
  const int arm = file.add_node(R"({"children": [)" + number(ball) + ", " + number(mesh) + "]}");
  const auto half = static_cast<float>(std::sin(kPi / 2));
  animate(file, arm, "rotation", {0, 1}, "VEC4", {0, 0, 0, 1, 0, 0, half, 0});
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->motions.size(), 2u);
  const SceneAccel accel(*scene, in_order());
  const reference::ReferenceAccel other(*scene, reference::structures().front());
  for (const float time : {0.0f, 0.125f, 0.5f, 0.8125f, 1.0f}) {
    const double angle = kPi * static_cast<double>(time);
    for (const double z : {0.0, 1.0}) {
      // From 0.15 above the ball's centre, straight at it.
      const Vec3d out = {std::cos(angle), std::sin(angle), 0};
      Ray ray;
      ray.origin = Vec3f(out * 1.15 + Vec3d{0, 0, z} - scene->center);
      ray.direction = Vec3f(-out);
      ray.time = time;
      Hit hit, same;
      ASSERT_TRUE(accel.closest_hit(ray, hit)) << time << " " << z;
      ASSERT_TRUE(other.closest_hit(ray, nullptr, same));
      EXPECT_TRUE(same_bits(hit, same));
      // The tolerance of add_motion() is 2^-10 of the ball's box, whose diagonal is 0.35 m, times
      // 4/3; the mesh is within 0.1 (1 - cos(pi / 8)^2) of the ball.
      EXPECT_NEAR(hit.t, 0.05f, z == 0 ? 0.00047 : 0.015) << time;
      // The ball was elsewhere at other times.
      ray.time = time < 0.5f ? time + 0.25f : time - 0.25f;
      EXPECT_FALSE(accel.closest_hit(ray, hit) && hit.t < 0.1f);
    }
  }
}

/// S curves and what stands still: keys are only where they are needed.
TEST(Shutter, PutsKeysWherePathsBendAndNowhereElse) {
  const auto keys = [](const char* interpolation, const std::vector<float>& times,
                       const std::vector<float>& values, double open, double close) {
    GltfBuilder file;
    add_camera(file, open, close);
    const int node = file.add_node_with_mesh(file.add_mesh(tessera::testing::unit_quad()));
    animate(file, node, "translation", times, "VEC3", values, interpolation);
    const auto scene = load_and_pose(file, all_animations());
    EXPECT_TRUE(scene.ok()) << scene.status();
    return scene.ok() ? scene->key_times : std::vector<float>{-1};
  };
  using Times = std::vector<float>;
  EXPECT_EQ(keys("LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0}, 0, 0.5), (Times{0, 1}));
  EXPECT_EQ(keys("LINEAR", {0, 1}, {0, 0, 0, 1, 0, 0}, 0.5, 0.5), Times{});
  EXPECT_EQ(keys("LINEAR", {0, 1}, {0, 0, 0, 0, 0, 0}, 0, 0.5), Times{});
  EXPECT_EQ(keys("LINEAR", {1, 2}, {0, 0, 0, 1, 0, 0}, 0, 0.5), Times{});
  EXPECT_EQ(keys("LINEAR", {0, 0.25f, 1}, {0, 0, 0, 1, 0, 0, 0, 1, 0}, 0, 0.5),
            (Times{0, 0.5f, 1}));
  // From (0, 0, 0) to (1, 0, 0) with no speed at either end: halfway it lies on the straight line.
  const Times curve =
      keys("CUBICSPLINE", {0, 1}, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0}, 0, 1);
  EXPECT_GT(curve.size(), 8u);
  EXPECT_LT(curve.size(), 40u);
  const Times jump = keys("STEP", {0, 0.3f}, {0, 0, 0, 1, 0, 0}, 0, 0.5);
  ASSERT_EQ(jump.size(), 4u);
  EXPECT_EQ(jump[2] - jump[1], 0x1p-24f);
  EXPECT_NEAR(jump[2], 0.6, 1e-6);
}

TEST(Shutter, FollowsJumpsWithoutSmearingThem) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  const int node = file.add_node_with_mesh(file.add_mesh(tessera::testing::unit_quad()));
  animate(file, node, "translation", {0, 0.3f}, "VEC3", {0, 0, 0, 4, 0, 0}, "STEP");
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->motions.size(), 1u);
  for (std::uint32_t k = 0; k <= 0x1000; ++k) {
    const float time = static_cast<float>(k) / 0x1000;
    const auto pose = pose_at(scene->motions[0], find_key(scene->key_times, time));
    ASSERT_TRUE(pose.has_value());
    EXPECT_EQ(pose->object_to_world.translation.x + scene->center.x, time < 0.3f ? 0 : 4) << time;
  }
}

TEST(Shutter, OfAStillSceneChangesNothing) {
  GltfBuilder open, closed;
  for (GltfBuilder* file : {&open, &closed}) {
    add_camera(*file, 0, file == &open ? 1 : 0);
    file->add_node_with_mesh(file->add_mesh(tessera::testing::unit_quad()));
    const int far = file->add_node(R"({})");
    animate(*file, far, "translation", {0, 1}, "VEC3", {0, 0, 0, 4, 0, 0});
  }
  auto settings = all_animations();
  const auto a = load_and_pose(open, settings), b = load_and_pose(closed, settings);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_TRUE(a->key_times.empty() && a->camera.keys.empty());
  EXPECT_EQ(render_picture(*a, settings).rgb, render_picture(*b, settings).rgb);
}

TEST(Shutter, SplitsMeshesThatArePosedAlikeOnlyAtTheFramesTime) {
  GltfBuilder file;
  add_camera(file, 0, 1);
  tessera::testing::TriangleMesh quad = tessera::testing::unit_quad();
  const int mesh = file.add_mesh(quad);
  const int moves = file.add_vec3({{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}});
  file.set("/meshes/0/primitives/0/targets", R"([{"POSITION": )" + number(moves) + "}]");
  const int still = file.add_node_with_mesh(mesh), up = file.add_node_with_mesh(mesh),
            down = file.add_node_with_mesh(mesh);
  animate(file, up, "weights", {0, 1}, "SCALAR", {0, 1});
  animate(file, down, "weights", {0, 1}, "SCALAR", {0, -1});
  const auto scene = load_and_pose(file, all_animations());
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_EQ(scene->instances.size(), 3u);
  for (const Instance& instance : scene->instances) {
    const Mesh& own = scene->meshes[static_cast<std::size_t>(instance.mesh)];
    ASSERT_EQ(own.keys.size(), instance.node == still ? 0u : 2u);
    if (own.keys.empty()) continue;
    EXPECT_EQ(own.keys[1][0].positions[0].z, instance.node == up ? 1 : -1);
    EXPECT_TRUE(own.keys[1][0].triangles.empty());
  }
}

// ---------------------------------------------------------------------------- pictures

/// A row of things that shine, move, and are lit from the side: one goes along, one round, one
/// grows, one bends. The wall behind is lit by them, too, and the camera moves.
std::unique_ptr<GltfBuilder> moving_row(double open, double close) {
  auto file = std::make_unique<GltfBuilder>();
  GltfBuilder& b = *file;
  const int camera = add_camera(b, open, close);
  animate(b, camera, "translation", {0, 1}, "VEC3", {0, 0, 5, 0.1f, 0, 4.5f});
  const auto half = static_cast<float>(std::sin(0.02)), rest = static_cast<float>(std::cos(0.02));
  animate(b, camera, "rotation", {0, 1}, "VEC4", {0, 0, 0, 1, 0, half, 0, rest});
  b.use_extension("KHR_lights_punctual");
  b.set("/extensions/KHR_lights_punctual/lights", R"([{"type": "directional", "intensity": 3}])");
  b.add_node(R"({"rotation": [0, 0.38268343, 0, 0.92387953],
                 "extensions": {"KHR_lights_punctual": {"light": 0}}})");
  const auto shining = [&](const std::string& color) {
    return b.add_material(
        R"({"emissiveFactor": )" + color +
        R"(, "doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}})");
  };
  const auto stripe = [&](float x, float width, int material) {
    tessera::testing::TriangleMesh mesh;
    mesh.positions = {{x, -1, 0}, {x + width, -1, 0}, {x + width, 1, 0}, {x, 1, 0}};
    mesh.indices = {0, 1, 2, 0, 2, 3};
    mesh.material = material;
    return b.add_mesh(mesh);
  };
  const int wall = b.add_node_with_mesh(
      stripe(-9, 18, b.add_material(R"({"pbrMetallicRoughness": {"metallicFactor": 0}})")));
  b.set("/nodes/" + number(wall) + "/translation", "[0, 0, -1]");
  const int along = b.add_node_with_mesh(stripe(0, 0.3f, shining("[1, 0.2, 0]")));
  animate(b, along, "translation", {0, 0.4f, 1}, "VEC3", {-1.5f, 0, 0, -0.9f, 0, 0, -1.2f, 0, 0});
  const int round = b.add_node_with_mesh(stripe(0.1f, 0.3f, shining("[0, 1, 0.3]")));
  const auto s = static_cast<float>(std::sin(0.6)), c = static_cast<float>(std::cos(0.6));
  animate(b, round, "rotation", {0, 1}, "VEC4", {0, -s, 0, c, 0, s, 0, c});
  const int growing = stripe(0.6f, 0.2f, shining("[0.1, 0, 1]"));
  const int moves = b.add_vec3({{0, 0, 0}, {0.5f, 0, 0}, {0.5f, 0, 0}, {0, 0, 0}});
  b.set("/meshes/" + number(growing) + "/primitives/0/targets",
        R"([{"POSITION": )" + number(moves) + "}]");
  const int grown = b.add_node_with_mesh(growing);
  animate(b, grown, "weights", {0, 1}, "SCALAR", {0, 1});
  // Bound to a joint that turns about z.
  const int bent = stripe(-0.5f, 0.2f, shining("[0.5, 0.5, 0]"));
  const std::vector<std::uint8_t> joints(16, 0);
  tessera::testing::AccessorSpec spec;
  spec.view = b.add_view(tessera::testing::bytes_of(joints));
  spec.component_type = tessera::testing::kUnsignedByte;
  spec.count = 4;
  spec.type = "VEC4";
  b.set("/meshes/" + number(bent) + "/primitives/0/attributes/JOINTS_0",
        number(b.add_accessor(spec)));
  b.set("/meshes/" + number(bent) + "/primitives/0/attributes/WEIGHTS_0",
        number(b.add_vec4({{1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}, {1, 0, 0, 0}})));
  const int joint = b.add_node("{}");
  animate(b, joint, "rotation", {0, 1}, "VEC4",
          {0, 0, 0, 1, 0, 0, s / 4, std::sqrt(1 - s * s / 16)});
  b.add("skins", R"({"joints": [)" + number(joint) + "]}");
  b.add_node_with_mesh(bent, R"({"skin": 0})");
  return file;
}

/// Mean and squared standard error of a pixel's channels over independent pictures.
struct Estimate {
  std::vector<double> sum, squares;
  double count = 0;
  void add(const std::vector<double>& rgb) {
    sum.resize(rgb.size());
    squares.resize(rgb.size());
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      sum[i] += rgb[i];
      squares[i] += rgb[i] * rgb[i];
    }
    ++count;
  }
  double mean(std::size_t i) const { return sum[i] / count; }
  double error2(std::size_t i) const {
    return std::max(squares[i] / count - mean(i) * mean(i), 0.0) / (count - 1);
  }
};

/// Motion blur of transforms, skins, morphs and cameras against the average of many sharp pictures,
/// each of the file without a shutter at a time of its own.
TEST(MotionBlur, IsTheAverageOfManySharpPictures) {
  constexpr double kOpen = 0.1, kClose = 0.9, kTick = 1e-6;
  constexpr int kTimes = 32;  // strata
  constexpr std::uint32_t kPictures = 16;
  const auto blurred = moving_row(kOpen, kClose), sharp = moving_row(0, 0);
  auto settings = all_animations();
  settings.max_depth = 1;
  settings.fps = 1 / kTick;
  const auto scene = load_and_pose(*blurred, settings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->motions.size(), 2u);
  EXPECT_GT(scene->camera.keys.size(), 1u);
  const SceneNeeds needs = needs_of(*scene), less = needs_of(*load_and_pose(*sharp, settings));
  EXPECT_EQ(needs.features, less.features | kNeedsMotion);
  EXPECT_GT(needs.total_bytes(), less.total_bytes());
  tessera::testing::MemoryReader reader;
  reader.put("scene.gltf", sharp->gltf());
  const auto file = load_scene_file("scene.gltf", settings, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  Estimate blur, average;
  for (std::uint32_t seed = 0; seed < kPictures; ++seed) {
    settings.seed = seed;
    settings.spp = 512;
    blur.add(render_picture(*scene, settings).rgb);
    settings.spp = 8;
    std::vector<double> sum;
    for (int i = 0; i < kTimes; ++i) {
      const double time = kOpen + (i + uniform(rng)) / kTimes * (kClose - kOpen);
      settings.seed = 1000 + seed * kTimes + static_cast<std::uint32_t>(i);
      const auto now =
          (*file)->pose(settings, static_cast<std::int32_t>(std::lround(time / kTick)));
      ASSERT_TRUE(now.ok()) << now.status();
      const Picture one = render_picture(*now, settings);
      sum.resize(one.rgb.size());
      for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += one.rgb[k] / kTimes;
    }
    average.add(sum);
  }
  double most = 0, mean_error = 0;
  const std::size_t count = blur.sum.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double error = std::sqrt(blur.error2(i) + average.error2(i));
    mean_error += error / static_cast<double>(count);
    const double off = std::abs(blur.mean(i) - average.mean(i));
    if (off > 1e-6) most = std::max(most, off / error);
  }
  // 72 values: the largest of as many t of 15 degrees of freedom passes 5.1 once in 100 times.
  // Paths are off by at most 4/3 2^-10 of 2 m: a fiftieth of a pixel.
  EXPECT_LT(most, 5.1);
  EXPECT_LT(mean_error, 6e-3) << most;
  EXPECT_GT(mean_error, 0);
}

}  // namespace
}  // namespace tessera::render::testing
