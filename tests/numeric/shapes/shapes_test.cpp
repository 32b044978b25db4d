// Hard cases 17, 18, 20, 23, 26, 30: intersections of lines with analytic shapes.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <string>

#include "tests/numeric/shapes/every_accelerator.h"
#include "tests/numeric/shapes/solid_scenes.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/shape_surface.h"

namespace tessera::render::testing {
namespace {

void expect_at(const std::vector<ShapeHit>& hits, const std::vector<double>& ts, double tolerance) {
  ASSERT_EQ(hits.size(), ts.size());
  for (std::size_t i = 0; i < ts.size(); ++i) EXPECT_NEAR(hits[i].t, ts[i], tolerance) << i;
}

/// The first root of the unit sphere in long double; false if there is none.
bool sphere_in_long_double(const Vec3f& o, const Vec3f& d, long double& t) {
  long double a = 0, b = 0, c = -1;
  for (int k = 0; k < 3; ++k) {
    a += static_cast<long double>(d[k]) * d[k];
    b += static_cast<long double>(o[k]) * d[k];
    c += static_cast<long double>(o[k]) * o[k];
  }
  const long double discriminant = b * b - a * c;
  if (discriminant < 0) return false;
  t = c / (-b + std::sqrt(discriminant));
  return true;
}

TEST(Shapes, DistantSphereHitsAreExact) {
  const SceneAccel accel(shape_scene(make_ellipsoid({1, 1, 1})), in_order());
  Dice dice(17);
  for (const float distance : {3e3f, 1e4f, 1e6f}) {
    int missed = 0, found = 0;
    float worst = 0;
    for (int i = 0; i < 20'000; ++i) {
      Ray ray;
      ray.origin = dice.direction() * distance;
      ray.direction = dice.direction() * dice.unit() - ray.origin;
      ray.direction = normalize(ray.direction);
      long double t = 0;
      if (!sphere_in_long_double(ray.origin, ray.direction, t)) continue;
      ++found;
      Hit hit;
      if (!accel.closest_hit(ray, hit)) {
        ++missed;
        continue;
      }
      worst = std::max(worst, std::fabs(hit.t - static_cast<float>(t)));
    }
    EXPECT_GT(found, 5'000) << distance;
    EXPECT_LE(missed, found / 10'000) << distance;
    EXPECT_LE(worst, 32 * (std::nextafter(distance, 2 * distance) - distance)) << distance;
  }
}

TEST(Shapes, TangentRaysHitOnceOrMiss) {
  const Scene scene = shape_scene(make_ellipsoid({1, 1, 1}));
  for (const float impact : {1 - 0x1p-23f, 1.0f, 1 + 0x1p-23f}) {
    Ray ray;
    ray.origin = {impact, 0, -10};
    ray.direction = {0, 0, 1};
    const std::vector<Hit> hits = all_hits(scene, ray);
    if (impact < 1) {
      ASSERT_EQ(hits.size(), 2u);
      EXPECT_NEAR(hits[0].t, 10 - 4.883e-4, 1e-4);
      continue;
    }
    EXPECT_LE(hits.size(), 1u);
    for (const Hit& hit : hits) EXPECT_NEAR(hit.t, 10, 1e-4);
  }
}

TEST(Torus, HitsAreExact) {
  const Shape torus = make_torus(1, 0.25);
  expect_at(hits_of(torus, {-3, 0, 0}, {1, 0, 0}), {1.75, 2.25, 3.75, 4.25}, 1e-9);
  expect_at(hits_of(torus, {-3, 0.25, 0}, {1, 0, 0}), {2, 2, 4, 4}, 1e-6);
  expect_at(hits_of(torus, {0.75, 0, -3}, {0, 0, 1}), {2, 3, 3, 4}, 1e-6);
  expect_at(hits_of(torus, {1.25, 0, -3}, {0, 0, 1}), {3, 3}, 1e-6);
  expect_at(hits_of(torus, {0, -3, 0}, {0, 1, 0}), {}, 0);
}

TEST(Torus, NoHitIsLostAtAnyDistance) {
  const Shape torus = make_torus(1, 0.25);
  Dice dice(20);
  for (const double distance : {3.0, 30.0, 300.0, 3000.0}) {
    int lost = 0, tried = 0;
    for (int i = 0; i < 20'000; ++i) {
      const double around = 6.283185307179586 * static_cast<double>(dice.unit());
      const double across = 6.283185307179586 * static_cast<double>(dice.unit());
      const Vec3d out = {std::cos(around), 0, std::sin(around)};
      const Vec3d normal = out * std::cos(across) + Vec3d{0, std::sin(across), 0};
      const Vec3d target = out + normal * 0.25;
      const Vec3d origin = Vec3d(dice.direction()) * distance;
      const Vec3d direction = normalize(target - origin);
      if (std::fabs(dot(direction, normal)) < 0.01) continue;  // near a double root
      ++tried;
      double nearest = 1;
      for (const ShapeHit& hit : hits_of(torus, origin, direction)) {
        nearest = std::min(nearest, length(origin + direction * hit.t - target));
      }
      if (!(nearest <= 1e-6)) ++lost;
    }
    EXPECT_EQ(lost, 0) << distance;
    EXPECT_GT(tried, 18'000);
  }
}

TEST(Shapes, ConeApexHasFiniteNormal) {
  const Shape cone = make_cone(1, 2, true);  // from y = -1 to its apex at y = 1
  const Scene scene = shape_scene(cone);
  for (const Vec3f& from : {Vec3f{0, 4, 0}, Vec3f{-3, 1, 0}, Vec3f{1, 3, 1}}) {
    Ray ray;
    ray.origin = from;
    ray.direction = Vec3f{0, 1, 0} - from;
    std::vector<Hit> hits = all_hits(scene, ray);
    std::erase_if(hits, [](const Hit& hit) { return hit.t > 1.5f; });  // leaves by the base
    // One hit where the ray continues inside; where it only touches, two roots may differ by an
    // ulp.
    ASSERT_GE(hits.size(), 1u);
    EXPECT_LE(hits.size(), from.x == 0 ? 1u : 2u);
    for (const Hit& hit : hits) {
      EXPECT_NEAR(hit.t, 1, 1e-6);
      const Vec3d normal = shape_normal(cone, hit.id.triangle, {hit.b0, hit.b1, hit.b2});
      EXPECT_TRUE(is_finite(Vec3f(normalize(normal))));
      EXPECT_NE(normalize(normal), Vec3d{});
    }
  }
}

TEST(Shapes, AxisRaysHitOnlyCaps) {
  const auto through = hits_of(make_cylinder(1, 2, true), {0.5, -5, 0.25}, {0, 1, 0});
  expect_at(through, {4, 6}, 0);
  EXPECT_EQ(through[0].face, 3u);
  EXPECT_EQ(through[1].face, 4u);
  EXPECT_TRUE(hits_of(make_cylinder(1, 2, false), {0.5, -5, 0.25}, {0, 1, 0}).empty());
}

TEST(Shapes, ZeroQuadraticCoefficientIsHandled) {
  // y + 1 = 2 (x^2 + z^2): along the axis the equation is linear.
  const auto bowl = hits_of(make_paraboloid(1, 2, true), {0.5, 5, 0}, {0, -1, 0});
  expect_at(bowl, {4, 5.5}, 1e-15);
  EXPECT_EQ(bowl[0].face, 4u);
  EXPECT_EQ(bowl[1].face, kCurvedFace);
  // Parallel to a line of the cone x^2 + z^2 = y^2.
  Quadric cone;
  cone.squares = {1, -1, 1};
  const Shape half = make_quadric(cone, {{-4, -4, -4}, {4, 0, 4}}, true);
  expect_at(hits_of(half, {0, -1, -3}, {0, -1, 1}), {1, 3}, 1e-12);
}

TEST(Shapes, FlattenedSphereHasEllipsoidNormals) {
  const Affine3d flat = scaled({1, 1, 0.01});
  const Scene scene = shape_scene(make_ellipsoid({1, 1, 1}), flat);
  Dice dice(26);
  for (int i = 0; i < 1'000; ++i) {
    const Vec3f on = dice.direction();
    const Vec3d gradient = {on.x, on.y, 100 * static_cast<double>(on.z)};
    const Vec3d normal = transform_normal(scene.instances[0].world_to_object,
                                          shape_normal(*scene.meshes[0].shape, 0, Vec3d(on)));
    EXPECT_LE(length(normalize(normal) - normalize(gradient)), 1e-6);
  }
}

TEST(Shapes, DepthsOfScaledSpheresCompare) {
  Scene scene;
  for (const auto& [scale, depth] : {std::pair{0.01, 5.0}, {1.0, 6.0}, {100.0, 7.0}}) {
    Affine3d m = scaled({scale, scale, scale});
    m.translation = {0, 0, depth + scale};
    place_shape(scene, make_ellipsoid({1, 1, 1}), m);
  }
  Ray ray;
  ray.direction = {0, 0, 1};
  std::vector<Hit> hits = all_hits(scene, ray);
  ASSERT_GE(hits.size(), 4u);
  std::erase_if(hits, [](const Hit& hit) { return hit.id.instance == 0 && hit.t > 5.01f; });
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(hits[i].id.instance, i);
    EXPECT_NEAR(hits[i].t, 5 + static_cast<float>(i), 4 * 0x1p-21f);
  }
}

/// A shape and an independent test of its inside.
struct Known {
  std::string name;
  Shape shape;
  std::function<bool(const Vec3d&)> inside;
};

double round2(const Vec3d& p) {
  return p.x * p.x + p.z * p.z;
}

Shape three_blobs() {
  return make_blobs({{{0.4, 0, 0}, {0.8, 0.6, 0.8}, 1},
                     {{-0.5, 0.1, 0}, {1, 1, 1}, 1.5},
                     {{0, 0.3, 0.2}, {0.5, 0.5, 0.5}, -1}},
                    0.25);
}

TerrainForm hills() {
  TerrainForm form;
  form.pattern = TerrainForm::Pattern::waves;
  form.size = {2, 1.5};
  form.height = 0.6;
  form.octaves = 2;
  return form;
}

std::vector<Known> known_shapes() {
  Quadric saddle;  // x^2 - z^2 - y / 2 <= 0
  saddle.squares = {1, 0, -1};
  saddle.linear = {0, -0.25, 0};
  const Box3d around = {{-1, -0.75, -1}, {0.75, 1, 1}};
  return {
      {"ellipsoid", make_ellipsoid({1, 0.5, 0.75}),
       [](const Vec3d& p) { return p.x * p.x + p.y * p.y * 4 + p.z * p.z / 0.5625 <= 1; }},
      {"box", make_box({1, 2, 1.5}),
       [](const Vec3d& p) {
         return std::fabs(p.x) <= 0.5 && std::fabs(p.y) <= 1 && std::fabs(p.z) <= 0.75;
       }},
      {"cylinder", make_cylinder(0.75, 1, true),
       [](const Vec3d& p) { return round2(p) <= 0.5625 && std::fabs(p.y) <= 0.5; }},
      {"cone", make_cone(0.75, 2, true),
       [](const Vec3d& p) {
         return std::fabs(p.y) <= 1 && std::sqrt(round2(p)) <= 0.75 * (1 - p.y) / 2;
       }},
      {"paraboloid", make_paraboloid(1, 1.5, true),
       [](const Vec3d& p) { return p.y <= 0.75 && round2(p) <= (p.y + 0.75) / 1.5; }},
      {"hyperboloid", make_one_sheet_hyperboloid(0.25, 1, 2, true),
       [](const Vec3d& p) {
         return std::fabs(p.y) <= 1 && round2(p) <= 0.0625 + 0.9375 * p.y * p.y;
       }},
      {"two-sheet-hyperboloid", make_two_sheet_hyperboloid(0.5, 1, 2, true),
       [](const Vec3d& p) {
         return std::fabs(p.y) <= 1 && round2(p) <= (p.y * p.y - 0.0625) / 0.9375;
       }},
      {"quadric", make_quadric(saddle, around, true),
       [around](const Vec3d& p) {
         return around.contains(p) && p.x * p.x - p.z * p.z - p.y / 2 <= 0;
       }},
      {"torus", make_torus(0.75, 0.25),
       [](const Vec3d& p) {
         const double out = std::sqrt(round2(p)) - 0.75;
         return out * out + p.y * p.y <= 0.0625;
       }},
      {"blobs", three_blobs(),
       [](const Vec3d& p) {
         const Vec3d q = {(p.x - 0.4) / 0.8, p.y / 0.6, p.z / 0.8}, r = p - Vec3d{-0.5, 0.1, 0};
         const Vec3d s = (p - Vec3d{0, 0.3, 0.2}) / 0.5;
         const auto field = [](const Vec3d& v) {
           const double left = std::max(1 - dot(v, v), 0.0);
           return left * left;
         };
         return field(q) + 1.5 * field(r) - field(s) >= 0.25;
       }},
      {"terrain", make_terrain(hills(), 0.75),
       [](const Vec3d& p) {
         const double wave =
             std::sin(2 * std::numbers::pi * p.x) * std::cos(2 * std::numbers::pi * p.z) +
             0.5 * std::sin(4 * std::numbers::pi * p.x) * std::cos(4 * std::numbers::pi * p.z);
         return std::fabs(p.x) <= 1 && std::fabs(p.z) <= 0.75 && p.y >= -0.75 &&
                p.y <= 0.3 + 0.2 * wave;
       }},
  };
}

TEST(Shapes, InsideIsBetweenHits) {
  Dice dice(1);
  for (const Known& known : known_shapes()) {
    int inside_count = 0, wrong = 0;
    for (int i = 0; i < 2'000; ++i) {
      const Vec3d origin = Vec3d(dice.vector()) * 3.0, direction(dice.vector());
      const std::vector<ShapeHit> hits = hits_of(known.shape, origin, direction);
      bool enters = true;
      double last = -1e9;
      for (const ShapeHit& hit : hits) {
        EXPECT_EQ(hit.enters, enters) << known.name;
        EXPECT_LE(last, hit.t) << known.name;
        EXPECT_LE(length(origin + direction * hit.t - hit.point), 1e-12) << known.name;
        enters = !enters;
        last = hit.t;
      }
      EXPECT_TRUE(enters) << known.name;
      for (int k = 0; k < 100; ++k) {  // the line, sampled
        const double t = 10 * static_cast<double>(dice.both());
        int before = 0;
        double nearest = 1;
        for (const ShapeHit& hit : hits) {
          before += hit.t < t ? 1 : 0;
          nearest = std::min(nearest, std::fabs(hit.t - t));
        }
        if (nearest < 1e-9) continue;
        const bool inside = known.inside(origin + direction * t);
        inside_count += inside ? 1 : 0;
        wrong += inside != (before % 2 == 1) ? 1 : 0;
      }
    }
    EXPECT_EQ(wrong, 0) << known.name;
    EXPECT_GT(inside_count, 300) << known.name;
  }
}

TEST(Shapes, NormalsPointOutwards) {
  Dice dice(2);
  for (const Known& known : known_shapes()) {
    for (int i = 0; i < 2'000; ++i) {
      const Vec3d origin = Vec3d(dice.vector()) * 3.0, direction(dice.vector());
      for (const ShapeHit& hit : hits_of(known.shape, origin, direction)) {
        const Vec3d normal = normalize(shape_normal(known.shape, hit.face, hit.point));
        if (std::fabs(dot(normal, normalize(direction))) < 1e-3) continue;
        EXPECT_EQ(dot(normal, direction) < 0, hit.enters) << known.name;
        EXPECT_FALSE(known.inside(hit.point + normal * 1e-6)) << known.name;
      }
    }
  }
}

/// All shapes at random places among triangles, and solids of some of them.
Scene crowd(Dice& dice) {
  Scene scene;
  scene.meshes.push_back(mesh_of({soup(40, dice)}));
  scene.meshes.push_back(mesh_of({uv_sphere(6, 8, 0.5f)}));
  place(scene, 0);
  for (const Known& known : known_shapes()) {
    place_shape(scene, known.shape,
                random_placement(dice, 0.2 + 0.3 * static_cast<double>(dice.unit()),
                                 Vec3d(dice.vector()), dice.below(2) == 0));
  }
  place_shape(scene, make_disc(0.5), random_placement(dice, 1, Vec3d(dice.vector()), false));
  place_shape(scene, make_rectangle(1, 0.5), random_placement(dice, 1, Vec3d(dice.vector()), true));
  place_shape(scene, make_cylinder(0.4, 1, false), moved({0.5, 0, 0}));
  for (int i = 0; i < 2; ++i) place_shape(scene, make_box({0.5, 0.5, 0.5}));  // ties
  for (const CsgOperation operation : {CsgOperation::unite, CsgOperation::intersect,
                                       CsgOperation::subtract, CsgOperation::exclude}) {
    const auto first = static_cast<std::uint32_t>(scene.instances.size());
    const Vec3d at(dice.vector());
    place(scene, 1, random_placement(dice, 0.6, at, dice.below(2) == 0));
    place_shape(scene, operation == CsgOperation::exclude ? three_blobs() : make_torus(0.75, 0.25),
                random_placement(dice, 0.4, at, false));
    place(scene, 1, random_placement(dice, 0.4, at, false));
    combine(scene, operation, first);
  }
  return scene;
}

TEST(Shapes, HitsMatchInEveryAccelerator) {
  Dice dice(3);
  for (int round = 0; round < 3; ++round) {
    const Scene scene = crowd(dice);
    const EveryAccelerator every(scene);
    int wrong = 0, found = 0, on_solids = 0;
    Ray next;
    for (int i = 0; i < 4'000; ++i) {
      Ray ray = adversarial_ray(scene, dice);
      if (i % 4 == 1) ray = next;  // starts at the last hit
      const std::vector<Hit> expected = all_hits(scene, ray);
      found += expected.empty() ? 0 : 1;
      wrong += every.wrong_results(ray, expected);
      if (expected.empty()) continue;
      on_solids += expected[0].id.instance > 0 ? 1 : 0;
      next.origin = ray.origin + ray.direction * expected[0].t;
      next.direction = dice.vector();
      next.origin_triangle = expected[0].id;
    }
    EXPECT_EQ(wrong, 0) << round;
    EXPECT_GT(found, 2'000);
    EXPECT_GT(on_solids, 1'000);
  }
}

TEST(Shapes, FilterSeesEveryHitOnce) {
  Dice dice(4);
  const Scene scene = crowd(dice);
  std::vector<SceneAccel> own;
  own.emplace_back(scene, in_order(), Isa::avx2);
  if (best_isa() == Isa::avx512) own.emplace_back(scene, in_order(), Isa::avx512);
  int wrong = 0, found = 0;
  for (int i = 0; i < 4'000; ++i) {
    const Ray ray = adversarial_ray(scene, dice);
    const auto refused = [&](const Hit& hit) {
      return (hit.id.instance + hit.id.triangle + i) % 3;
    };
    std::vector<Hit> all = all_hits(scene, ray), taken;
    std::copy_if(all.begin(), all.end(), std::back_inserter(taken),
                 [&](const Hit& hit) { return refused(hit) == 0; });
    found += taken.empty() ? 0 : 1;
    for (const SceneAccel& accel : own) {
      Hit hit;
      const bool hits = accel.closest_hit(ray, hit, [&](const Hit& h) { return refused(h) == 0; });
      if (hits == taken.empty() || (hits && !same_bits(hit, taken[0]))) ++wrong;
      std::vector<Hit> shown;
      const bool any = accel.any_hit(ray, [&](const Hit& h) {
        shown.push_back(h);
        return false;
      });
      std::sort(shown.begin(), shown.end(), precedes);
      if (any || !std::equal(shown.begin(), shown.end(), all.begin(), all.end(), same_bits)) {
        ++wrong;
      }
    }
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(found, 1'000);
}

TEST(RaySpawning, ConvexShapeIsNotHitAgain) {
  Dice dice(8);
  const std::vector<Shape> convex = {make_ellipsoid({1, 1, 1}),
                                     make_ellipsoid({1, 0.2, 0.5}),
                                     make_cylinder(0.5, 1, true),
                                     make_cone(1, 1, true),
                                     make_box({1, 1, 1}),
                                     make_paraboloid(1, 1, true),
                                     make_blobs({{{}, {1, 1, 1}, 1}}, 0.05)};
  int left = 0, again = 0;
  for (int i = 0; i < 60'000; ++i) {
    const double size = std::pow(10.0, i % 4 * 3 - 3), offset = i / 4 % 2 == 0 ? 0 : size * 1e3;
    const Affine3d at =
        random_placement(dice, size, Vec3d(dice.direction()) * offset, dice.below(2) == 0);
    const Scene scene = shape_scene(convex[dice.below(7)], at);
    const Vec3d inside = Vec3d(dice.vector()) * 0.2;
    Ray ray;
    ray.origin = Vec3f(transform_point(at, Vec3d(dice.direction()) * 3.0));
    ray.direction = Vec3f(transform_point(at, inside)) - ray.origin;
    Hit hit;
    if (!brute_force_closest(scene, ray, hit)) continue;
    const Vec3d local = {hit.b0, hit.b1, hit.b2};
    const Vec3f normal(
        normalize(transform_normal(scene.instances[0].world_to_object,
                                   shape_normal(*scene.meshes[0].shape, hit.id.triangle, local))));
    const SurfacePoint point = placed_shape_point(at, Vec3f(local), normal);
    Vec3f outwards = dice.direction();
    if (dot(outwards, normal) < 0) outwards = -outwards;
    if (i % 3 == 0) outwards = normalize(outwards - normal * (dot(outwards, normal) * 0.999f));
    ++left;
    again += brute_force_closest(scene, spawn_ray(point, hit.id, outwards), hit) ? 1 : 0;
  }
  EXPECT_EQ(again, 0);
  EXPECT_GT(left, 50'000);
}

TEST(RaySpawning, FlatFaceIsNotHitAgain) {
  Scene alone = shape_scene(make_box({1, 1, 1})), joined = alone;
  combine(joined, CsgOperation::unite);
  for (const Scene& scene : {alone, joined}) {
    Ray ray;
    ray.origin = {0, 0.5f, 0};
    ray.origin_triangle = {0, 0, 4};  // the upper face across y
    ray.direction = {0, 1, 0};
    EXPECT_TRUE(all_hits(scene, ray).empty());
    ray.direction = {0, -1, 0};
    const std::vector<Hit> hits = all_hits(scene, ray);
    ASSERT_EQ(hits.size(), 1u);
    EXPECT_EQ(hits[0].t, 1);
    EXPECT_EQ(hits[0].id.triangle, 3u);
  }
}

}  // namespace
}  // namespace tessera::render::testing
