/// Motion blur: rays find moving objects while the shutter is open (hard case 31).
#include "worker/geometry/motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/numeric/motion/moving_scenes.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/accelerators/structure_accelerator.h"

namespace tessera::render::testing {
namespace {

TEST(LerpBounded, StaysBetweenItsEnds) {
  Dice dice(1);
  for (int i = 0; i < 1'000'000; ++i) {
    const float a = dice.both() * std::exp2(static_cast<float>(dice.below(40)) - 20);
    const float b = dice.below(4) == 0 ? a : dice.both();
    const float v = lerp_bounded(a, b, dice.below(8) == 0 ? 1.0f : dice.unit());
    ASSERT_GE(v, std::min(a, b));
    ASSERT_LE(v, std::max(a, b));
  }
}

TEST(FindKey, ReturnsSegmentOfEveryTime) {
  const std::vector<float> times = {0, 0.25f, 0.25f + 0x1p-24f, 0.5f, 1};
  for (std::uint32_t k = 0; k + 1 < times.size(); ++k) {
    EXPECT_EQ(find_key(times, times[k]).segment, k);
    EXPECT_EQ(find_key(times, times[k]).f, 0);
  }
  EXPECT_EQ(find_key(times, 0.75f).segment, 3u);
  EXPECT_EQ(find_key(times, 0.75f).f, 0.5f);
  EXPECT_EQ(find_key(times, 1).f, 1);
}
/// The scene at a time, for rays of that time.
Scene at_time(const Scene& scene, float time) {
  Scene now = scene;
  const KeyframePosition at = find_key(scene.key_times, time);
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
        primitives[p].positions[v] = lerp_bounded(mesh.keys[at.segment][p].positions[v],
                                                  mesh.keys[at.segment + 1][p].positions[v], at.f);
      }
    }
    mesh.primitives = std::move(primitives);
  }
  return now;
}

/// Rays at many times, and their hits by brute force.
struct Shots {
  std::vector<Ray> rays;
  std::vector<bool> found;
  std::vector<Hit> hits;
  int count = 0, moving = 0;

  void add(const Scene& scene, const Ray& ray) {
    Hit hit;
    rays.push_back(ray);
    found.push_back(brute_force_closest(scene, ray, hit));
    hits.push_back(hit);
    if (!found.back()) return;
    ++count;
    const Instance& instance = scene.instances[hit.id.instance];
    const bool moves = instance.motion != kNone ||
                       !scene.meshes[static_cast<std::size_t>(instance.mesh)].keys.empty();
    moving += moves ? 1 : 0;
  }
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
      if (dice.below(8) == 0) ray.origin_triangle = {dice.below(12), dice.below(2), dice.below(10)};
      out.add(scene, ray);
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
  accelerators::StructureAccelerator accel;
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

TEST(MotionBounds, AllAcceleratorsFindSameHits) {
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
  for (const accelerators::Structure& structure : accelerators::structures()) {
    const Reference accel{accelerators::StructureAccelerator(scene, structure)};
    EXPECT_EQ(mismatches(accel, shots), 0) << structure.name;
  }
}

/// Each moving object is flattened, wholly or along an axis, at one key or at the frame's time.
TEST(MotionBounds, FlattenedInstancesKeepTheirHits) {
  Dice dice(33);
  Scene scene = moving_scene(dice);
  for (std::size_t i = 0; i < scene.motions.size(); ++i) {
    Affine3d& key = scene.motions[i][dice.below(4) + 1u];
    const Vec3d stays = i % 3 == 0 ? Vec3d{1, 0, 1} : Vec3d{};
    for (Vec3d& row : key.rows) row = row * stays;
  }
  for (Instance& instance : scene.instances) {
    if (instance.motion == kNone || dice.below(2) == 0) continue;
    for (Vec3d& row : instance.object_to_world.rows) row = {};
    instance.world_to_object = {};
    instance.flat = true;
  }
  const Shots shots = shoot(scene, 60, 60, dice);
  EXPECT_GT(shots.moving, 500);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    EXPECT_EQ(mismatches(SceneAccel(scene, in_order(), isa), shots), 0);
  }
  for (const accelerators::Structure& structure : accelerators::structures()) {
    const Reference accel{accelerators::StructureAccelerator(scene, structure)};
    EXPECT_EQ(mismatches(accel, shots), 0) << structure.name;
  }
}

/// Thin objects far from their origins that rotate fast, for which world boxes matter most.
Scene rotating_objects(Dice& dice) {
  Scene scene;
  scene.key_times = {0, 1};
  scene.meshes = {mesh_of({uv_sphere(3, 4, 0.01f, {1, 0, 0})})};
  for (int i = 0; i < 40; ++i) {
    place(scene, 0, random_placement(dice, 1, Vec3d(dice.vector()), false));
    // Any angle up to half a turn, where linear interpolation shrinks it to nothing.
    scene.instances.back().motion = i;
    const Affine3d all = random_placement(dice, 1, Vec3d(dice.vector()), i % 3 == 0);
    const Affine3d turn = lerp(Affine3d{}, all, i % 4 == 0 ? 1 : 0.3f * dice.unit());
    const Affine3d& from = scene.instances.back().object_to_world;
    scene.motions.push_back({from, from * turn});
  }
  return scene;
}

TEST(MotionBounds, EncloseRotatingInstances) {
  Dice dice(32);
  const Scene scene = rotating_objects(dice);
  const Shots shots = shoot(scene, 100, 40, dice);
  EXPECT_GT(shots.moving, 1'500);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    EXPECT_EQ(mismatches(SceneAccel(scene, in_order(), isa), shots), 0);
  }
}

/// An outermost point of a placed mesh along an axis, moved inwards by 2e-4 of a triangle.
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

/// Rays just inside the faces of the boxes at keys, where the moving objects touch them.
TEST(MotionBounds, GrazingRaysHitMovingInstances) {
  Dice dice(33);
  const Scene scene = rotating_objects(dice);
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
    shots.add(scene, ray);
  }
  EXPECT_GT(shots.count, 300);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    EXPECT_EQ(mismatches(SceneAccel(scene, in_order(), isa), shots), 0);
  }
}

/// Like SceneAccel.SquashedInstancesAreNotCulled for static instances: scaled by 1e-4 along a
/// slanted axis, rounding the ray in object space moves it in the world by much more than an ulp.
TEST(MotionBounds, SquashedInstancesAreNotCulled) {
  Dice dice(34);
  Scene scene;
  scene.key_times = {0, 1};
  scene.meshes = {mesh_of({soup(1, dice)})};
  for (int i = 0; i < 8; ++i) {
    Affine3d m = random_placement(dice, 1, {0, 0, 0}, false);
    m.rows[1] *= 1e-4;
    m = random_placement(dice, 1, Vec3d(dice.vector()), false) * m;
    place(scene, 0, m);
    scene.instances.back().motion = i;
    Affine3d moved = m;
    moved.translation = m.translation + Vec3d(dice.vector());
    scene.motions.push_back({m, moved});
  }
  Shots shots;
  for (int i = 0; i < 40'000; ++i) {
    const std::uint32_t instance = dice.below(8), key = dice.below(2);
    const Vec3f vertex = edge_or_vertex(scene.meshes[0].primitives[0], false, dice);
    const Vec3f near(transform_point(scene.motions[instance][key], Vec3d(vertex)));
    Ray ray;
    ray.time = scene.key_times[key];
    ray.origin = dice.vector() * 2.0f;
    ray.direction = near + dice.vector() * 1e-3f - ray.origin;
    shots.add(scene, ray);
  }
  EXPECT_GT(shots.count, 400);
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (!is_supported(isa)) continue;
    EXPECT_EQ(mismatches(SceneAccel(scene, in_order(), isa), shots), 0);
  }
}

}  // namespace
}  // namespace tessera::render::testing
