// Hard cases 6, 11, 15, 16, 28, 30, 33, 34: hits of SceneAccel equal those of brute force bit
// for bit, for any input.

#include <gtest/gtest.h>
#include <xmmintrin.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "tests/numeric/geometry/geometry_scenes.h"
#include "tests/support/full_size.h"
#include "worker/accel/build/mesh_bvh.h"
#include "worker/accel/build/wide_bvh.h"
#include "worker/accel/reference/brute_force.h"
#include "worker/accel/reference/plain_traversal.h"
#include "worker/accel/traversal/thread_counts.h"

namespace tessera::render::testing {
namespace {

constexpr float kInf = std::numeric_limits<float>::infinity();
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::vector<Isa> supported_isas() {
  std::vector<Isa> isas;
  for (const Isa isa : {Isa::avx2, Isa::avx512}) {
    if (is_supported(isa)) isas.push_back(isa);
  }
  return isas;
}

/// Options of an accelerator that counts its work.
TraceOptions counted(Isa isa = best_isa()) {
  TraceOptions options = isa;
  options.counted = true;
  return options;
}

/// Counts rays for which closest_hit or any_hit differs from brute force in any bit.
int mismatches(const Scene& scene, int rays, std::uint32_t seed, int* hits = nullptr) {
  std::vector<SceneAccel> accels;
  for (const Isa isa : supported_isas()) accels.emplace_back(scene, in_order(), isa);
  accels.emplace_back(scene, in_order(), counted());
  Dice dice(seed);
  int wrong = 0;
  for (int i = 0; i < rays; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    Hit slow;
    const bool expected = brute_force_closest(scene, ray, slow);
    for (const SceneAccel& accel : accels) {
      Hit fast;
      const bool found = accel.closest_hit(ray, fast);
      if (found != expected || (found && !same_bits(fast, slow))) ++wrong;
      if (accel.any_hit(ray) != expected) ++wrong;
    }
    if (hits != nullptr && expected) ++*hits;
  }
  return wrong;
}

/// Returns rays with nearby origins and similar directions, like camera rays; one bundle in four
/// has arbitrary directions.
std::vector<Ray> bundle(const Scene& scene, std::size_t count, Dice& dice) {
  const Ray first = adversarial_ray(scene, dice);
  const float width = dice.below(4) == 0 ? 2.0f : std::exp2(-12 * dice.unit());
  const bool one_origin = dice.below(2) == 0;
  // If the first ray lies in a plane of boxes, all rays do; a direction of 0 gives 0 * inf there.
  int flat = -1;
  for (int k = 0; k < 3; ++k) {
    if (first.direction[k] == 0) flat = k;
  }
  std::vector<Ray> rays(count, first);
  for (Ray& ray : rays) {
    if (!one_origin) ray.origin += dice.vector() * width;
    ray.direction += dice.vector() * (width * max_abs(first.direction));
    if (flat >= 0) {
      ray.origin[flat] = first.origin[flat];
      ray.direction[flat] = dice.below(2) == 0 ? 0 : std::fabs(ray.direction[flat]);
    }
    if (dice.below(16) == 0) ray.t_max = 2 * dice.unit();
    if (dice.below(16) == 0) ray = adversarial_ray(scene, dice);
    if (dice.below(64) == 0) ray.direction = {0, 0, 0};
    if (dice.below(4) == 0) {
      ray.origin_triangle = {dice.below(3), dice.below(2), dice.below(20)};
    }
  }
  return rays;
}

/// Counts rays for which packets differ in any bit from single rays; a few are also compared with
/// brute force.
int packet_mismatches(const Scene& scene, int packets, std::uint32_t seed, int* hits = nullptr) {
  std::vector<SceneAccel> accels;
  for (const Isa isa : supported_isas()) accels.emplace_back(scene, in_order(), isa);
  Dice dice(seed);
  int wrong = 0;
  for (int i = 0; i < packets; ++i) {
    const auto count = static_cast<std::size_t>(i % 4 == 0 ? 1 + dice.below(64) : 64);
    const std::vector<Ray> rays = bundle(scene, count, dice);
    for (const SceneAccel& accel : accels) {
      std::array<Hit, kPacketSize> together;
      const std::uint64_t found = accel.closest_hits(rays, together.data());
      const std::uint64_t any = accel.any_hits(rays);
      if (count < 64 && ((found | any) >> count) != 0) ++wrong;
      for (std::size_t k = 0; k < count; ++k) {
        Hit alone;
        const bool expected = k % 16 == 0 ? brute_force_closest(scene, rays[k], alone)
                                          : accel.closest_hit(rays[k], alone);
        const bool got = (found >> k & 1) != 0;
        if (got != expected || (got && !same_bits(together[k], alone))) ++wrong;
        if (((any >> k & 1) != 0) != expected) ++wrong;
        if (hits != nullptr && expected && &accel == &accels.front()) ++*hits;
      }
    }
  }
  return wrong;
}

TEST(RayPackets, MatchSingleRays) {
  Dice dice(120);
  int hits = 0;
  EXPECT_EQ(packet_mismatches(scene_of({soup(150, dice), soup(50, dice)}), 400, 121, &hits), 0);
  EXPECT_EQ(packet_mismatches(scene_of({terrain(40, dice)}), 300, 122, &hits), 0);
  EXPECT_EQ(packet_mismatches(scene_of({needles(1'000, dice)}), 300, 123, &hits), 0);
  EXPECT_EQ(packet_mismatches(scene_of({uv_sphere(24, 32, 1)}), 300, 124, &hits), 0);
  EXPECT_GT(hits, 15'000) << "too few rays hit for a meaningful test";
}

TEST(RayPackets, MatchSingleRaysOnInstances) {
  Dice dice(130);
  Scene scene;
  scene.meshes.push_back(mesh_of({soup(20, dice), soup(10, dice)}));
  scene.meshes.push_back(mesh_of({uv_sphere(12, 16, 1)}));
  for (int i = 0; i < 40; ++i) {
    const double scale = std::exp2(-6 * dice.unit());
    place(scene, i % 2, random_placement(dice, scale, Vec3d(dice.vector()), i % 3 == 0));
  }
  place(scene, 0);
  place(scene, 0);  // an exact duplicate
  Affine3d far;
  far.translation = {1e5, -3e5, 2e4};
  place(scene, 0, far);
  int hits = 0;
  EXPECT_EQ(packet_mismatches(scene, 400, 131, &hits), 0);
  EXPECT_GT(hits, 10'000);
}

TEST(SceneAccel, SoupsAgree) {
  int hits = 0;
  for (std::uint32_t seed = 0; seed < 6; ++seed) {
    Dice dice(seed);
    EXPECT_EQ(mismatches(scene_of({soup(150, dice), soup(50, dice)}), 8'000, seed, &hits), 0);
  }
  EXPECT_GT(hits, 15'000) << "too few rays hit for a meaningful test";
}

TEST(SceneAccel, SplitNeedlesMatchBruteForce) {
  Dice dice(10);
  const Scene scene = scene_of({needles(3'000, dice)});
  const MeshBvh<16> tree = build_mesh_bvh<16>(scene.meshes[0], in_order());
  ASSERT_TRUE(tree.split) << "the test needs split triangles";
  int hits = 0;
  EXPECT_EQ(mismatches(scene, 4'000, 11, &hits), 0);
  EXPECT_GT(hits, 2'000);
}

TEST(SceneAccel, TenThousandTrianglesMatchBruteForce) {  // hard case 15
  // 100,000 rays at full size, two thirds through edges, vertices or planes.
  Dice dice(15);
  int hits = 0;
  EXPECT_EQ(mismatches(scene_of({soup(9'000, dice), terrain(22, dice)}),
                       tessera::testing::full_size(100'000, 5'000), 16, &hits),
            0);
  EXPECT_GT(hits, tessera::testing::full_size(20'000, 1'000));
}

TEST(SceneAccel, TerrainAgrees) {
  Dice dice(20);
  EXPECT_EQ(mismatches(scene_of({terrain(12, dice)}), 20'000, 21), 0);
  EXPECT_EQ(mismatches(scene_of({terrain(48, dice)}), 2'000, 22), 0);
}

TEST(SceneAccel, InstancesAgree) {
  Dice dice(30);
  Scene scene;
  scene.meshes.push_back(mesh_of({soup(20, dice), soup(10, dice)}));
  scene.meshes.push_back(mesh_of({uv_sphere(4, 6, 1)}));
  scene.meshes.push_back(mesh_of({}));
  for (int i = 0; i < 12; ++i) {
    const double scale = std::exp2(-6 * dice.unit());
    place(scene, i % 3, random_placement(dice, scale, Vec3d(dice.vector()), i % 2 == 0));
  }
  place(scene, 0);
  place(scene, 1);
  place(scene, 1);                                      // an exact duplicate
  place(scene, 0, scene.instances[3].object_to_world);  // and a transformed one
  Affine3d squashed = random_placement(dice, 1, {0, 0, 0}, false);
  squashed.rows[1] *= 1e-4;
  place(scene, 1, squashed);
  Affine3d far;
  far.translation = {1e5, -3e5, 2e4};
  place(scene, 0, far);
  EXPECT_EQ(mismatches(scene, 20'000, 31), 0);
}

/// Small spheres along the diagonal of x and y, turned on to the x axis and lifted.
Scene turned_chain() {
  std::vector<Primitive> spheres;
  for (int i = -16; i <= 16; ++i) {
    const auto at = static_cast<float>(i);
    spheres.push_back(uv_sphere(4, 6, 0.25f, {at, at, 0}));
  }
  Scene scene;
  scene.meshes = {mesh_of(std::move(spheres))};
  const double c = std::sqrt(0.5);
  place(scene, 0, {{{{c, c, 0}, {-c, c, 0}, {0, 0, 1}}}, {0, 3, 0}});
  place(scene, 0, {{{{c, c, 0}, {-c, c, 0}, {0, 0, 1}}}, {0, -30, 0}});
  return scene;
}

TEST(SceneAccel, TurnedInstancesAreBoundByParts) {
  const Scene scene = turned_chain();
  EXPECT_EQ(mismatches(scene, 4000, 77), 0);
  // Below the chain, where only a box around its turned box, +-17 in y, would be.
  const SceneAccel accel(scene, in_order(), counted());
  const contract::TraversalCounts before = thread_traversal_counts();
  Hit hit;
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(
        accel.closest_hit({{-20, -10 + 0.01f * static_cast<float>(i), 0}, {1, 0, 0}}, hit));
  }
  const contract::TraversalCounts work = thread_traversal_counts() - before;
  EXPECT_LE(work.nodes, 100) << "the root over the two instances";
}

TEST(SceneAccel, SquashedInstancesAreNotCulled) {
  // Scaled by 1e-4 along a slanted axis, so that rounding the ray in object space moves it in the
  // world by much more than an ulp, at triangles whose vertices are the extremes of the box.
  Dice dice(35);
  Scene scene;
  scene.meshes.push_back(mesh_of({soup(1, dice)}));
  for (int i = 0; i < 8; ++i) {
    Affine3d m = random_placement(dice, 1, {0, 0, 0}, false);
    m.rows[1] *= 1e-4;
    m = random_placement(dice, 1, Vec3d(dice.vector()), false) * m;
    place(scene, 0, m);
  }
  const SceneAccel accel(scene, in_order());
  int hits = 0;
  for (int i = 0; i < 100'000; ++i) {
    const Instance& instance = scene.instances[dice.below(8)];
    const Vec3f vertex = edge_or_vertex(scene.meshes[0].primitives[0], false, dice);
    const Vec3f near(transform_point(instance.object_to_world, Vec3d(vertex)));
    Ray ray;
    ray.origin = dice.vector() * 2.0f;
    ray.direction = near + dice.vector() * 1e-3f - ray.origin;
    Hit fast, slow;
    const bool found = accel.closest_hit(ray, fast);
    ASSERT_EQ(found, brute_force_closest(scene, ray, slow)) << i;
    ASSERT_TRUE(!found || same_bits(fast, slow));
    hits += found ? 1 : 0;
  }
  EXPECT_GT(hits, 1'000);
}

TEST(SceneAccel, FarOriginsMatchBruteForce) {
  Dice dice(40);
  Scene scene;
  scene.meshes.push_back(mesh_of({uv_sphere(6, 8, 1)}));
  for (int i = 0; i < 5; ++i)
    place(scene, 0, random_placement(dice, 0.3, Vec3d(dice.vector()), false));
  const SceneAccel accel(scene, in_order());
  int hits = 0;
  for (int i = 0; i < 20'000; ++i) {
    Ray ray;
    ray.origin = dice.direction() * std::exp2(24 * dice.unit());
    ray.direction = dice.vector() - ray.origin;
    Hit fast, slow;
    const bool found = accel.closest_hit(ray, fast);
    ASSERT_EQ(found, brute_force_closest(scene, ray, slow));
    ASSERT_TRUE(!found || same_bits(fast, slow));
    hits += found ? 1 : 0;
  }
  EXPECT_GT(hits, 1000);
}

TEST(SceneAccel, FilteredHitsMatchBruteForce) {
  Dice dice(50);
  Scene scene = scene_of({soup(100, dice), needles(20, dice)});
  scene.materials.resize(1);
  scene.materials[0].alpha_mode = AlphaMode::mask;
  const SceneAccel accel(scene, in_order());
  const auto opaque = [](const Hit& hit) { return hit.id.triangle % 3 != 0; };
  for (int i = 0; i < 5'000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    Hit fast, slow;
    bool expected = false;
    std::vector<TriangleId> all;
    brute_force_hits(scene, ray, [&](const Hit& hit) {
      all.push_back(hit.id);
      if (!opaque(hit) || (expected && !precedes(hit, slow))) return;
      slow = hit;
      expected = true;
    });
    ASSERT_EQ(accel.closest_hit(ray, fast, opaque), expected);
    ASSERT_TRUE(!expected || same_bits(fast, slow));
    ASSERT_EQ(accel.any_hit(ray, opaque), expected);
    std::vector<TriangleId> seen;
    const auto collect = [&](const Hit& hit) {
      seen.push_back(hit.id);
      return false;
    };
    ASSERT_FALSE(accel.any_hit(ray, collect));
    std::sort(seen.begin(), seen.end());
    ASSERT_EQ(seen, all);
  }
}

TEST(SceneAccel, AllHitsReportSplitTrianglesOnce) {
  Dice dice(55);
  const Scene scene = scene_of({needles(1'000, dice)});
  ASSERT_TRUE(build_mesh_bvh<16>(scene.meshes[0], in_order()).split);
  std::vector<SceneAccel> accels;
  for (const Isa isa : supported_isas()) accels.emplace_back(scene, in_order(), isa);
  std::size_t hits = 0;
  for (int i = 0; i < 1'000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    std::vector<TriangleId> all;
    brute_force_hits(scene, ray, [&](const Hit& hit) { all.push_back(hit.id); });
    for (const SceneAccel& accel : accels) {
      std::vector<TriangleId> seen;
      accel.any_hit(ray, [&](const Hit& hit) {
        seen.push_back(hit.id);
        return false;
      });
      std::sort(seen.begin(), seen.end());
      ASSERT_EQ(seen, all);
    }
    hits += all.size();
  }
  EXPECT_GT(hits, 500u);
}

TEST(SceneAccel, CoplanarTieGoesToLowestId) {
  const Primitive a = quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0});
  Scene scene;
  scene.meshes.push_back(mesh_of({a, a, a}));
  scene.meshes.push_back(mesh_of({a}));
  place(scene, 0);  // three copies, then one of its own
  place(scene, 1);
  place(scene, 0);
  std::vector<SceneAccel> accels;
  for (const Isa isa : supported_isas()) {
    accels.emplace_back(scene, in_order(), isa);
    accels.emplace_back(scene, in_reverse(), isa);
  }
  Dice dice(60);
  for (int i = 0; i < 10'000; ++i) {
    Ray ray;
    ray.origin = {dice.both(), dice.both(), 1 + dice.unit()};
    ray.direction = Vec3f{dice.both(), dice.both(), 0} - ray.origin;
    Hit first;
    ASSERT_TRUE(accels.front().closest_hit(ray, first));
    ASSERT_EQ(first.id.instance, 0u);
    ASSERT_EQ(first.id.primitive, 0u);
    for (const SceneAccel& accel : accels) {
      Hit hit;
      ASSERT_TRUE(accel.closest_hit(ray, hit));
      ASSERT_TRUE(same_bits(hit, first));
    }
  }
}

TEST(SceneAccel, AxisParallelRaysVisitNoMoreNodes) {
  Dice dice(70);
  const Primitive surface = terrain(64, dice);
  std::vector<Box3f> boxes;
  boxes.reserve(surface.triangles.size());
  for (const auto& triangle : surface.triangles) {
    Box3f box;
    for (const std::uint32_t vertex : triangle) box.extend(surface.positions[vertex]);
    boxes.push_back(box);
  }
  const WideBvh<8> bvh = collapse<8>(build_binary_bvh({boxes, 8}, in_order()));
  int visits[2] = {0, 0};
  for (int tilted = 0; tilted < 2; ++tilted) {
    for (int i = 0; i < 64 * 64; ++i) {
      // Rays in the vertices' planes and beside the mesh, where 0 * inf occurs.
      const int column = i % 64 - 16, row = i / 64 - 16;
      const Vec3f origin = {static_cast<float>(column) / 32, 1, static_cast<float>(row) / 32};
      ObjectRay ray;
      ASSERT_TRUE(make_object_ray(origin, {tilted * 1e-3f, -1, tilted * 1e-3f}, bvh.bounds, ray));
      const float limit = std::numeric_limits<float>::max();
      traverse_plain(
          bvh.nodes.data(), 0, ray, limit, [](std::uint32_t) {}, [&] { ++visits[tilted]; });
    }
  }
  EXPECT_LE(visits[0], visits[1] + visits[1] / 2);
}

TEST(TraversalCost, MissesMatchPlainTraversal) {
  Dice dice(71);
  const Scene scene = scene_of({soup(3000, dice)});
  const SceneAccel accel(scene, in_order(), counted());
  const MeshBvh<8> tree = build_mesh_bvh<8>(scene.meshes[0], in_order(), BuildQuality::normal);
  int misses = 0;
  for (int i = 0; i < 4000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    Hit hit;
    contract::TraversalCounts before = thread_traversal_counts();
    if (accel.closest_hit(ray, hit)) continue;
    const contract::TraversalCounts closest = thread_traversal_counts() - before;
    before = thread_traversal_counts();
    EXPECT_FALSE(accel.any_hit(ray));
    const contract::TraversalCounts any = thread_traversal_counts() - before;
    ObjectRay object_ray;
    if (!make_object_ray(ray.origin, ray.direction, tree.bounds, object_ray)) continue;
    contract::TraversalCounts expected{1, 0, 0};
    const float limit = std::min(ray.t_max, std::numeric_limits<float>::max());
    traverse_plain(
        tree.nodes.data(), 0, object_ray, limit,
        [&](std::uint32_t block) {
          for (std::size_t lane = 0; lane < kBlockSize; ++lane) {
            expected.primitives += tree.blocks.data()[block].has_triangle(lane) ? 1 : 0;
          }
        },
        [&] { ++expected.nodes; });
    ASSERT_TRUE(closest == expected) << "ray " << i;
    ASSERT_TRUE(any == expected) << "ray " << i;
    ++misses;
  }
  EXPECT_GT(misses, 500);
}

TEST(TraversalCost, DoesNotDependOnProcessor) {
  Dice dice(72);
  const Scene scene = scene_of({needles(300, dice)});
  std::vector<SceneAccel> accels;
  for (const Isa isa : supported_isas()) accels.emplace_back(scene, in_order(), counted(isa));
  for (int i = 0; i < 1000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    std::vector<contract::TraversalCounts> costs;
    for (const SceneAccel& accel : accels) {
      const contract::TraversalCounts before = thread_traversal_counts();
      Hit hit;
      accel.closest_hit(ray, hit);
      costs.push_back(thread_traversal_counts() - before);
    }
    ASSERT_TRUE(costs.front() == costs.back()) << "ray " << i;
    ASSERT_EQ(costs.front().rays, 1);
  }
}

TEST(SceneAccel, PowerOfTwoScaleKeepsEveryBit) {
  Dice dice(80);
  const Primitive small = soup(200, dice);
  std::vector<Ray> rays;
  rays.reserve(4'000);
  const Scene base_scene = scene_of({small});
  const SceneAccel base(base_scene, in_order());
  for (int i = 0; i < 4'000; ++i) rays.push_back(adversarial_ray(base_scene, dice));
  for (const int k : {-20, -10, 10, 30}) {
    const float scale = std::ldexp(1.0f, k);
    Primitive scaled = small;
    for (Vec3f& p : scaled.positions) p = p * scale;
    const SceneAccel accel(scene_of({scaled}), in_order());
    for (const Ray& ray : rays) {
      Ray big = ray;
      big.origin = ray.origin * scale;
      big.direction = ray.direction * scale;
      Hit a, b;
      const bool found = base.closest_hit(ray, a);
      ASSERT_EQ(accel.closest_hit(big, b), found) << k;
      ASSERT_TRUE(!found || same_bits(a, b)) << k;
    }
  }
}

TEST(SceneAccel, ExtremeScalesMatchBruteForce) {
  Dice dice(90);
  Scene scene;
  scene.meshes.push_back(mesh_of({uv_sphere(4, 6, 1)}));
  place(scene, 0, random_placement(dice, 1e-20, {0, 0, 0}, false));
  place(scene, 0, random_placement(dice, 1e15, {0, 0, 0}, false));
  Affine3d flat;
  flat.rows[1] *= 1e-20;
  place(scene, 0, flat);
  EXPECT_EQ(mismatches(scene, 5'000, 91), 0);
}

TEST(SceneAccel, DepthsOfScaledInstancesCompare) {
  Scene scene;
  scene.meshes.push_back(mesh_of({quad({-1, -1, 0}, {2, 0, 0}, {0, 2, 0})}));
  const std::array<double, 3> scales = {1, 100, 0.01};
  const std::array<double, 3> depths = {6, 7, 5};
  for (std::size_t i = 0; i < 3; ++i) {
    Affine3d m;
    for (Vec3d& row : m.rows) row *= scales[i];
    m.translation = {0, 0, -depths[i]};
    place(scene, 0, m);
  }
  const SceneAccel accel(scene, in_order());
  Ray ray;
  ray.origin = {0.0012f, 0.0034f, 0};
  ray.direction = {0, 0, -1};
  std::vector<Hit> hits;
  accel.any_hit(ray, [&](const Hit& hit) {
    hits.push_back(hit);
    return false;
  });
  std::sort(hits.begin(), hits.end(), precedes);
  ASSERT_EQ(hits.size(), 3u);
  const std::array<std::uint32_t, 3> order = {2, 0, 1};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(hits[i].id.instance, order[i]);
    EXPECT_NEAR(hits[i].t, static_cast<double>(5 + i), 4 * 0x1p-21);
  }
}

TEST(SceneAccel, InvalidRaysMiss) {
  const SceneAccel accel(scene_of({uv_sphere(8, 8, 1)}), in_order());
  std::vector<Ray> invalid(9);
  for (Ray& ray : invalid) ray.direction = {0, 0, 1};
  invalid[0].direction = {0, 0, 0};
  invalid[1].direction = {kNan, 0, 1};
  invalid[2].direction = {0, -kInf, 0};
  invalid[3].origin = {kNan, kNan, kNan};
  invalid[4].origin = {0, kInf, 0};
  invalid[5].t_max = 0;
  invalid[6].t_max = kNan;
  invalid[7].t_max = -1;
  invalid[8].direction = {0x1p-149f, 0, 0};
  const SceneAccel counting(scene_of({uv_sphere(8, 8, 1)}), in_order(), counted());
  for (const Ray& ray : invalid) {
    Hit hit;
    EXPECT_FALSE(accel.closest_hit(ray, hit));
    EXPECT_FALSE(accel.any_hit(ray));
    const contract::TraversalCounts before = thread_traversal_counts();
    EXPECT_FALSE(counting.closest_hit(ray, hit));
    EXPECT_FALSE(counting.any_hit(ray));
    const contract::TraversalCounts work = thread_traversal_counts() - before;
    EXPECT_EQ(work.nodes + work.primitives, 0) << "a constant time, whatever the scene";
  }
  EXPECT_FALSE(SceneAccel(Scene{}, in_order()).any_hit(Ray{{0, 0, 0}, {0, 0, 1}}));
}

TEST(SceneAccel, DenormalDirectionsActAsZero) {
  Dice dice(110);
  const Scene scene = scene_of({uv_sphere(12, 16, 1)});
  const SceneAccel accel(scene, in_order());
  const unsigned int mode = _mm_getcsr();
  for (int i = 0; i < 2'000; ++i) {
    Ray zero;
    zero.origin = {0.9f * dice.both(), 0.9f * dice.both(), -2};
    zero.direction = {0, 0.01f * dice.both(), 1};
    Ray tiny = zero;
    tiny.direction.x = i % 2 == 0 ? 1e-40f : -1e-40f;
    Hit a, b, c;
    const bool found = accel.closest_hit(zero, a);
    ASSERT_EQ(accel.closest_hit(tiny, b), found);
    _mm_setcsr(mode | 0x8040u);  // flush-to-zero and denormals-are-zero, as set by some libraries
    const bool flushed = accel.closest_hit(zero, c);
    _mm_setcsr(mode);
    ASSERT_EQ(flushed, found);
    ASSERT_TRUE(!found || (same_bits(a, b) && same_bits(a, c)));
  }
}

}  // namespace
}  // namespace tessera::render::testing
