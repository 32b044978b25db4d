// Infinite planes: hits, pictures and CSG against closed forms.

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "tests/numeric/motion/moving_scenes.h"
#include "tests/numeric/shapes/every_accelerator.h"
#include "tests/numeric/shapes/solid_scenes.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/accel/build/instance_boxes.h"
#include "worker/geometry/shapes/shape_surface.h"

namespace tessera::render::testing {
namespace {

using tessera::testing::add_material;
using tessera::testing::empty_scene;
using tessera::testing::lambert;
using tessera::testing::look_at;
using tessera::testing::Picture;
using tessera::testing::render_picture;
using tessera::testing::set_constant_sky;
using tessera::testing::small_settings;

/// A rotation that takes +y to an axis of the given sign, with entries 0 and +-1.
Affine3d facing(int axis, double sign) {
  Affine3d m;
  m.rows = {Vec3d{0, 0, 0}, Vec3d{0, 0, 0}, Vec3d{0, 0, 0}};
  const auto row = [&m](int k) -> Vec3d& { return m.rows[static_cast<std::size_t>(k)]; };
  row(axis).y = sign;
  row((axis + 1) % 3).z = sign;
  row((axis + 2) % 3).x = 1;
  return m;
}

/// t at which a ray meets the placed plane y = 0, in long double.
long double t_in_long_double(const Affine3d& at, const Ray& ray) {
  using Long = long double;
  const auto column = [&at](int i, int k) {
    return static_cast<Long>(at.rows[static_cast<std::size_t>(i)][k]);
  };
  Long height = 0, slope = 0;
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const Long normal = column(j, 2) * column(k, 0) - column(k, 2) * column(j, 0);
    height += normal * (static_cast<Long>(ray.origin[i]) - static_cast<Long>(at.translation[i]));
    slope += normal * static_cast<Long>(ray.direction[i]);
  }
  return -height / slope;
}

TEST(Plane, HitsMatchLongDouble) {
  Dice dice(1);
  int found = 0;
  for (int i = 0; i < 20'000; ++i) {
    const double scale = std::pow(10.0, 4 * static_cast<double>(dice.both()));
    const Affine3d at =
        random_placement(dice, scale, Vec3d(dice.vector()) * 10.0, dice.below(2) == 0);
    const Scene scene = shape_scene(make_plane(), at);
    Ray ray;
    ray.origin = dice.vector() * 100.0f;
    ray.direction = dice.vector();
    const long double t = t_in_long_double(at, ray);
    const std::vector<Hit> hits = all_hits(scene, ray);
    const bool meets = !hits.empty() && hits[0].id.triangle == 4;
    ASSERT_EQ(meets, t >= 0) << i;
    if (!meets) continue;
    ++found;
    // Rounded once to float, after double arithmetic whose error grows as the height and the slope
    // cancel.
    EXPECT_NEAR(static_cast<double>(hits[0].t), static_cast<double>(t),
                static_cast<double>(t) * (0x1p-24 + 1e-10) + 1e-10)
        << i;
    EXPECT_EQ(hits[0].b1, 0) << i;  // exactly in the plane
  }
  EXPECT_GT(found, 8'000);
}

TEST(Plane, RaysAlongItMiss) {
  const Scene scene = shape_scene(make_plane());
  Ray ray;
  ray.origin = {1, 0x1p-140f, 2};
  for (const float down : {0.0f, -0.0f, 0x1p-60f}) {
    ray.direction = {1, down, 0.5f};
    EXPECT_TRUE(all_hits(scene, ray).empty()) << down;
  }
  ray.origin.y = 1e-3f;  // the least slope below the horizon meets it
  ray.direction = {1, -1e-14f, 0};
  ASSERT_EQ(all_hits(scene, ray).size(), 2u);
  EXPECT_NEAR(all_hits(scene, ray)[0].t / 1e11f, 1, 1e-6);
}

TEST(Plane, SpawnedRaysDoNotHitIt) {
  Dice dice(2);
  int shallow = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Affine3d at = random_placement(dice, 1 + dice.unit(), Vec3d(dice.vector()), false);
    const Scene scene = shape_scene(make_plane(), at);
    const Vec3f normal(normalize(transform_normal(scene.instances[0].world_to_object, {0, 1, 0})));
    // Up to 1e6 m from its origin, leaving at angles down to 1e-6.
    const float far = std::pow(10.0f, 6 * dice.unit());
    const Vec3f local = {far * dice.both(), 0, far * dice.both()};
    const SurfacePoint point = placed_shape_point(at, local, normal);
    const Vec3f along = normalize(cross(normal, dice.vector()));
    const float slope = std::pow(10.0f, -6 * dice.unit());
    const Ray ray = spawn_ray(point, {0, 0, 4}, normalize(along + normal * slope));
    EXPECT_TRUE(all_hits(scene, ray).empty()) << i;
    shallow += slope < 1e-4f ? 1 : 0;
  }
  EXPECT_GT(shallow, 4'000);
}

TEST(Plane, TextureCoordinatesAreMetres) {
  const Shape plane = make_plane();
  EXPECT_EQ(shape_uv(plane, 4, {2.25f, 0, -7.5f}), (Vec2f{2.25f, -7.5f}));
  EXPECT_EQ(shape_uv(plane, 4, {1e6f, 0, 0.5f}), (Vec2f{1e6f, 0.5f}));
  EXPECT_EQ(shape_normal(plane, 4, {1, 0, 1}), (Vec3d{0, 1, 0}));
  // u increases along the tangent.
  EXPECT_EQ(shape_tangent(plane, 4, {0, 0, 0}), (Vec4f{1, 0, 0, -1}));
}

/// Planes in all poses among other objects, and solids of planes with and without bounds.
Scene flat_world(Dice& dice) {
  Scene scene;
  scene.meshes = {mesh_of({soup(40, dice)}), mesh_of({uv_sphere(6, 8, 0.5f)})};
  for (int i = 0; i < 8; ++i) {
    place(scene, i % 2,
          random_placement(dice, 0.5, Vec3d(dice.vector()) * 2.0, dice.below(2) == 0));
  }
  place_shape(scene, make_plane(), moved({0, -1, 0}));
  place_shape(scene, make_plane(), random_placement(dice, 0.01, {0, 0, -3}, false));
  place_shape(scene, make_plane(), random_placement(dice, 30, {4, 0, 0}, true));
  for (const CsgOperation operation : {CsgOperation::unite, CsgOperation::intersect,
                                       CsgOperation::subtract, CsgOperation::exclude}) {
    const auto first = static_cast<std::uint32_t>(scene.instances.size());
    const Vec3d at = Vec3d(dice.vector()) - Vec3d{0, 2, 0};
    place_shape(scene, make_plane(), random_placement(dice, 1, at, dice.below(2) == 0));
    place(scene, 1, random_placement(dice, 1.5, at, false));
    place_shape(scene, make_torus(0.75, 0.25), random_placement(dice, 1, at, false));
    if (operation == CsgOperation::intersect) place_shape(scene, make_plane(), moved(at));
    combine(scene, operation, first);
  }
  return scene;
}

/// Compares all structures with brute force, for rays from near and from far.
void expect_agreement(const Scene& scene, Dice& dice, int rays) {
  const EveryAccelerator every(scene);
  int wrong = 0, on_planes = 0;
  Ray next;
  for (int i = 0; i < rays; ++i) {
    Ray ray = adversarial_ray(scene, dice);
    if (i % 3 == 1) ray = next;  // starts at the last hit
    if (i % 8 == 7) {            // from beyond everything but the planes
      ray.origin = dice.direction() * std::pow(10.0f, 1 + 5 * dice.unit());
      ray.direction = dice.vector() * 3.0f - ray.origin;
    }
    ray.time = dice.unit();
    const std::vector<Hit> expected = all_hits(scene, ray);
    wrong += every.wrong_results(ray, expected);
    if (expected.empty()) continue;
    const Instance& hit = scene.instances[expected[0].id.instance];
    if (scene.meshes[static_cast<std::size_t>(hit.mesh)].shape != nullptr) ++on_planes;
    next.origin = ray.origin + ray.direction * expected[0].t;
    next.direction = dice.vector();
    next.origin_triangle = expected[0].id;
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(on_planes, rays / 4);
}

TEST(Plane, HitsMatchInEveryAccelerator) {
  Dice dice(3);
  for (int round = 0; round < 2; ++round) expect_agreement(flat_world(dice), dice, 2'000);
  expect_agreement(shape_scene(make_plane()), dice, 200);
}

TEST(Plane, MovingHitsMatchInEveryAccelerator) {
  Dice dice(4);
  Scene scene = flat_world(dice);
  scene.key_times = {0, 0.25f, 1};
  for (std::uint32_t i = 0; i < scene.instances.size(); i += 2) move(scene, i, dice, 0.1);
  expect_agreement(scene, dice, 1'000);
}

TEST(PlaneCsg, SixHalfSpacesAreABox) {
  // The planes' matrices have entries 0 and +-1, so heights are exact: t differs by at most its
  // rounding to float.
  Scene six;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double sign : {-1.0, 1.0}) {
      Affine3d at = facing(axis, sign);
      at.translation[axis] = sign * (0.5 + axis);
      place_shape(six, make_plane(), at);
    }
  }
  combine(six, CsgOperation::intersect);
  const Scene one = shape_scene(make_box({1, 3, 5}));
  Dice dice(5);
  int found = 0, different = 0;
  for (int i = 0; i < 20'000; ++i) {
    Ray ray;
    ray.origin = dice.vector() * 6.0f;
    ray.direction = dice.vector() * 2.0f - ray.origin;
    const std::vector<Hit> a = all_hits(six, ray), b = all_hits(one, ray);
    ASSERT_EQ(a.size(), b.size()) << i;
    for (std::size_t k = 0; k < a.size(); ++k) {
      ++found;
      different += a[k].t == b[k].t ? 0 : 1;
      EXPECT_NEAR(a[k].t, b[k].t, b[k].t * 0x1p-23f) << i;
    }
  }
  EXPECT_GT(found, 5'000);
  EXPECT_LE(different, found / 1'000);
}

TEST(PlaneCsg, InsideIsBetweenHits) {
  // Half-space minus ball, and box cut by a slanted plane, sampled along lines.
  Scene hollow;
  place_shape(hollow, make_plane());
  place_shape(hollow, ball(1), moved({0.5, -0.25, 0}));
  combine(hollow, CsgOperation::subtract);
  const Affine3d slanted = Affine3d{{Vec3d{0.8, 0.6, 0}, Vec3d{-0.6, 0.8, 0}, Vec3d{0, 0, 1}}, {}};
  Scene cut;
  place_shape(cut, make_box({2, 2, 2}));
  place_shape(cut, make_plane(), slanted);
  combine(cut, CsgOperation::intersect);
  const auto in_hollow = [](const Vec3d& p) {
    const Vec3d q = p - Vec3d{0.5, -0.25, 0};
    return p.y <= 0 && dot(q, q) >= 1;
  };
  const auto in_cut = [](const Vec3d& p) { return max_abs(p) <= 1 && 0.6 * p.x + 0.8 * p.y <= 0; };
  Dice dice(6);
  int inside_count = 0;
  for (int i = 0; i < 4'000; ++i) {
    const bool first = i % 2 == 0;
    Ray ray;
    ray.origin = dice.vector() * 3.0f;
    ray.direction = dice.vector();
    const std::vector<Hit> hits = all_hits(first ? hollow : cut, ray);
    const auto inside = [&](double t) {
      const Vec3d p = Vec3d(ray.origin) + Vec3d(ray.direction) * t;
      return first ? in_hollow(p) : in_cut(p);
    };
    for (int k = 0; k < 20; ++k) {
      const double t = 8 * static_cast<double>(dice.unit());
      bool now = inside(0);
      double nearest = 1;
      for (const Hit& hit : hits) {
        if (static_cast<double>(hit.t) < t) now = !now;
        nearest = std::min(nearest, std::fabs(static_cast<double>(hit.t) - t));
      }
      if (nearest < 1e-5) continue;
      EXPECT_EQ(now, inside(t)) << i;
      inside_count += now ? 1 : 0;
    }
  }
  EXPECT_GT(inside_count, 5'000);
}

TEST(PlaneCsg, OnlyUnboundedResultsStayOutsideTree) {
  const auto boxes_of = [](CsgOperation operation, bool plane_first) {
    Scene scene;
    place_shape(scene, plane_first ? make_plane() : ball(1));
    place_shape(scene, plane_first ? ball(1) : make_plane());
    combine(scene, operation);
    const std::vector<Box3f> bounds = {scene.meshes[0].shape->bounds,
                                       scene.meshes[1].shape->bounds};
    return bound_instances(scene, bounds);
  };
  const auto is_bounded = [&](CsgOperation operation, bool plane_first) {
    const InstanceBoxes boxes = boxes_of(operation, plane_first);
    EXPECT_EQ(boxes.boxes.size() + boxes.unbounded.size(), 1u);
    return boxes.unbounded.empty();
  };
  EXPECT_TRUE(is_bounded(CsgOperation::intersect, true));
  EXPECT_TRUE(is_bounded(CsgOperation::intersect, false));
  EXPECT_TRUE(is_bounded(CsgOperation::subtract, false));
  EXPECT_FALSE(is_bounded(CsgOperation::subtract, true));
  EXPECT_FALSE(is_bounded(CsgOperation::unite, false));
  EXPECT_FALSE(is_bounded(CsgOperation::exclude, true));
  EXPECT_NEAR(boxes_of(CsgOperation::intersect, true).boxes[0].hi.x, 1, 1e-3);
}

/// A plane of a material in an empty scene.
Scene ground(const Material& material, const Affine3d& at = {}) {
  Scene scene = empty_scene();
  const std::int32_t index = add_material(&scene, material);
  std::vector<Primitive> surface(1);
  surface[0].material = index;
  scene.meshes.push_back({"plane", surface, std::make_shared<const Shape>(make_plane())});
  place(scene, 0, at);
  return scene;
}

TEST(PlanePicture, HorizonIsAtEyeLevel) {
  // Black ground below a white sky: the mean over a column is the share of the sky.
  for (const double pitch : {0.0, 0.1, -0.2}) {
    for (const double height : {1e-2, 1.0, 1e4}) {
      Scene scene = ground(lambert({0, 0, 0}));
      set_constant_sky(&scene, 1);
      look_at(&scene, {0, height, 0}, {0, height + std::sin(pitch), -std::cos(pitch)});
      scene.camera.yfov = 0.8;
      const Picture picture = render_picture(std::move(scene), small_settings(1, 64, 256));
      // Pixels above the horizon, whose image is tan(pitch) below the middle.
      const double expected = 0.5 + 0.5 * std::tan(pitch) / std::tan(0.4);
      EXPECT_NEAR(picture.mean(), expected, 0.01 / 64) << pitch << " " << height;
    }
  }
}

TEST(PlanePicture, ConstantSkyGivesAlbedo) {
  for (const double scale : {1e-3, 1.0, 1e6, 1e12}) {
    Scene scene = ground(lambert({0.5f, 0.25f, 1}), scaled({scale, scale, scale}));
    set_constant_sky(&scene, 2);
    look_at(&scene, {0, 3, 0}, {0, 0, -20});
    scene.camera.yfov = 0.2;
    const Picture picture = render_picture(std::move(scene), small_settings(4, 4, 16));
    for (std::int32_t i = 0; i < 4; ++i) {
      EXPECT_NEAR(picture.at(i, i).x, 1, 1e-5) << scale;
      EXPECT_NEAR(picture.at(i, i).y, 0.5, 1e-5) << scale;
      EXPECT_NEAR(picture.at(i, i).z, 2, 1e-5) << scale;
    }
  }
}

TEST(PlanePicture, ShadowOfBallIsAnEllipse) {
  Scene scene = ground(lambert({1, 1, 1}));
  const std::int32_t hidden = add_material(&scene, lambert({0, 0, 0}));
  std::vector<Primitive> surface(1);
  surface[0].material = hidden;
  scene.meshes.push_back({"ball", surface, std::make_shared<const Shape>(ball(0.5))});
  place(scene, 1, moved({0, 4, 0}));
  PunctualLight sun;
  sun.kind = PunctualLight::Kind::directional;
  sun.direction = {0.8f, -0.6f, 0};  // the shadow is around x = 16/3
  sun.intensity = {1, 1, 1};
  scene.lights.push_back(sun);
  look_at(&scene, {5.333333333, 2, 1e-9}, {5.333333333, 0, 0});
  scene.camera.kind = Camera::Kind::orthographic;
  scene.camera.ymag = 1;
  const Picture picture = render_picture(std::move(scene), small_settings(64, 64, 64));
  const double lit = 0.6 / std::numbers::pi,
               shadow = std::numbers::pi * 0.25 / 0.6;  // of the 4 m^2 seen
  EXPECT_NEAR(picture.mean() / lit, 1 - shadow / 4, 1e-3);
}

TEST(PlanePicture, DistantCameraSeesPlaneBeforeScene) {
  // A white wall halfway between a black ball and a camera 1e5 times as far away as the ball is
  // large: rays must not start behind the wall.
  Affine3d wall = facing(2, 1);
  wall.translation = {0, 0, 5e4};
  Scene scene = ground(lambert({1, 1, 1}), wall);
  const std::int32_t black = add_material(&scene, lambert({0, 0, 0}));
  std::vector<Primitive> surface(1);
  surface[0].material = black;
  scene.meshes.push_back({"ball", surface, std::make_shared<const Shape>(ball(1))});
  place(scene, 1);
  scene.bounds_min = {-1, -1, -1};
  scene.bounds_max = {1, 1, 1};
  set_constant_sky(&scene, 1);
  look_at(&scene, {0, 0, 1e5}, {0, 0, 0});
  scene.camera.yfov = 1e-5;
  EXPECT_NEAR(render_picture(std::move(scene), small_settings(4, 4, 1)).mean(), 1, 1e-6);
}

TEST(PlanePicture, EmissionIsFoundWithoutSampling) {
  // A ceiling that shines everywhere lights like a sky: no choice of directions adds noise.
  Material shine = lambert({0, 0, 0});
  shine.emission = {3, 3, 3};
  Scene scene = ground(lambert({0.5f, 0.5f, 0.5f}));
  const std::int32_t index = add_material(&scene, shine);
  std::vector<Primitive> surface(1);
  surface[0].material = index;
  scene.meshes.push_back({"ceiling", surface, scene.meshes[0].shape});
  Affine3d above = facing(1, -1);
  above.translation = {0, 10, 0};
  place(scene, 1, above);
  Material bright = shine;  // a small lamp, whose light only sampling finds
  bright.emission = {3000, 3000, 3000};
  surface[0].material = add_material(&scene, bright);
  scene.meshes.push_back({"lamp", surface, std::make_shared<const Shape>(ball(0.1))});
  place(scene, 2, moved({0, 5, 0}));
  look_at(&scene, {0, 1, 0}, {0, 0, -3});
  scene.camera.yfov = 0.1;
  const Picture picture = render_picture(std::move(scene), small_settings(2, 2, 16));
  // The lamp is at (0, 5, 0), the camera looks at (0, 0, -3).
  const double lamp = 3000 * (0.01 / 34) * (5 / std::sqrt(34));
  EXPECT_NEAR(picture.mean(), 0.5 * (3 + lamp), 0.01);
}

/// Clear water below y = 0 that absorbs by 0.3 a metre, under a sky of radiance 1.
Scene sea() {
  Material water = lambert({0.5f, 0.5f, 0.5f});
  water.medium.emplace();
  water.medium->absorption = {0.3f, 0.3f, 0.3f};
  Scene scene = ground(water);
  set_constant_sky(&scene, 1);
  scene.camera.yfov = 1e-6;
  return scene;
}

double seen(Scene scene, const Vec3d& eye, const Vec3d& target) {
  look_at(&scene, eye, target);
  return render_picture(std::move(scene), small_settings(1, 1, 1)).mean();
}

TEST(CameraInside, WaterBelowAPlaneAbsorbs) {
  EXPECT_NEAR(seen(sea(), {0, -2, 0}, {1e-9, 0, 0}), std::exp(-0.6), 1e-6);
  EXPECT_NEAR(seen(sea(), {0, -2, 0}, {2, 0, 0}), std::exp(-0.6 * std::sqrt(2)), 1e-6);
  EXPECT_NEAR(seen(sea(), {0, -2, 0}, {0, -3, 1}), 0, 1e-9);  // down into the deep
  EXPECT_NEAR(seen(sea(), {0, -2, 0}, {1, -2, 0}), 0, 1e-9);  // along the surface
  EXPECT_NEAR(seen(sea(), {0, 2, 0}, {1, 2.1, 0}), 1, 1e-9);
  EXPECT_NEAR(seen(sea(), {0, 2, 0}, {1, 3, 0}), 1, 1e-9);
}

TEST(CameraInside, CavityBelowAPlaneIsDry) {
  Scene scene = sea();
  std::vector<Primitive> surface(1);
  surface[0].material = 1;
  scene.meshes.push_back({"cavity", surface, std::make_shared<const Shape>(ball(1))});
  place(scene, 1, moved({0, -3, 0}));
  combine(scene, CsgOperation::subtract);
  EXPECT_NEAR(seen(scene, {0, -3, 0}, {1e-9, 0, 0}), std::exp(-0.6), 1e-6);  // 2 m of water above
  EXPECT_NEAR(seen(scene, {0, -5, 0}, {1e-9, 0, 0}), std::exp(-0.9), 1e-6);
}

}  // namespace
}  // namespace tessera::render::testing
