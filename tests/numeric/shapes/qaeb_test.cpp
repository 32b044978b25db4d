// QAEB tracing of terrain against production's interval bounds.

#include "tests/support/render/qaeb.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/numeric/shapes/solid_scenes.h"
#include "tests/support/scene/plain_scene.h"
#include "worker/geometry/shapes/intersect_shape.h"

namespace tessera::render::testing {
namespace {

using Pattern = TerrainForm::Pattern;
using tessera::testing::QaebTerrain;

constexpr Vec3d kEye = {-1, 1.2, 2.5};

TerrainForm landscape(Pattern pattern, double height, double spot_angle) {
  TerrainForm form;
  form.pattern = pattern;
  form.size = {6, 6};
  form.height = height;
  form.scale = 0.8;
  form.octaves = 6;
  form.seed = 31;
  form.spot_angle = spot_angle;
  form.seen_from = kEye;
  return form;
}

/// Rough, smooth and almost flat terrain, with all detail and with what a pixel resolves.
std::vector<TerrainForm> landscapes() {
  return {landscape(Pattern::ridged, 1, 0), landscape(Pattern::ridged, 1, 0.004),
          landscape(Pattern::fbm, 1.5, 0.004), landscape(Pattern::waves, 0.5, 0),
          landscape(Pattern::ridged, 1e-3, 0.01)};
}

/// A ray of the picture from kEye.
Ray view_ray(Dice& dice) {
  Ray ray;
  ray.origin = Vec3f(kEye);
  ray.direction = normalize(Vec3f{0.3f + 0.7f * dice.both(), -0.35f + 0.4f * dice.both(), -1});
  return ray;
}

/// Distances along a unit ray at which production finds ground.
std::vector<double> crossings(const Shape& shape, const Ray& ray) {
  std::vector<ShapeHit> hits;
  intersect_shape(shape, Vec3d(ray.origin), Vec3d(ray.direction), hits, {0});
  std::vector<double> out;
  for (const ShapeHit& hit : hits) out.push_back(hit.t);
  return out;
}

/// Whether the ray is in the air half of the resolved detail before and behind t: production leaves
/// out such grazes, a sample may meet them by chance.
bool is_graze(const Shape& shape, const Ray& ray, double t) {
  const auto is_above = [&](double at) {
    const Vec3d p = Vec3d(ray.origin) + Vec3d(ray.direction) * at;
    return p.y > shape.terrain->height({p.x, p.z});
  };
  const Vec3d p = Vec3d(ray.origin) + Vec3d(ray.direction) * t;
  const double reach = shape.terrain->precision({p.x, p.z});
  return is_above(t - reach) && is_above(t + reach);
}

TEST(Qaeb, HitsAreWithinOneStepOfProduction) {
  Dice dice(7);
  for (const TerrainForm& form : landscapes()) {
    const Scene scene = shape_scene(make_terrain(form, 0));
    const Shape& shape = *scene.meshes[0].shape;
    for (const double error : {1.0 / 64, 1.0 / 512}) {
      const QaebTerrain qaeb(scene, kEye, error, 0.01);
      int found = 0, elsewhere = 0, skipped = 0;
      for (int i = 0; i < 2'000; ++i) {
        const Ray ray = view_ray(dice);
        Hit hit;
        const bool hits = qaeb.closest_hit(ray, nullptr, hit);
        found += hits ? 1 : 0;
        const auto t = static_cast<double>(hits ? hit.t : ray.t_max);
        // The hit is a crossing up to a step; pairs of crossings before it are at most a step
        // apart.
        double left = -1, nearest = hits ? 1e9 : 0;
        for (const double at : crossings(shape, ray)) {
          const double step = 1.001 * error * at + 1e-6;
          nearest = std::min(nearest, std::fabs(at - t) / step);
          if (at > t - step) break;
          const bool leaves = left >= 0;
          if (leaves && at - left > step) ++skipped;
          left = leaves ? -1 : at;
        }
        elsewhere += nearest > 1 && !is_graze(shape, ray, t) ? 1 : 0;
      }
      EXPECT_EQ(elsewhere, 0) << form.height << " " << error;
      EXPECT_EQ(skipped, 0) << form.height << " " << error;
      EXPECT_GT(found, 500);
    }
  }
}

TEST(Qaeb, ErrorsAndMissesFallWithStep) {
  const Scene scene = shape_scene(make_terrain(landscape(Pattern::ridged, 1, 0.002), 0));
  const SceneAccel production(scene, in_order());
  double last_off = 1;
  int last_missed = 2'000;
  for (const double error : {1.0 / 32, 1.0 / 128, 1.0 / 512}) {
    const QaebTerrain qaeb(scene, kEye, error, 0.01);
    Dice dice(8);
    int missed = 0, both = 0;
    double off = 0;
    for (int i = 0; i < 4'000; ++i) {
      const Ray ray = view_ray(dice);
      Hit a, b;
      const bool exact = production.closest_hit(ray, a),
                 marched = qaeb.closest_hit(ray, nullptr, b);
      if (!exact && !marched) continue;
      if (!exact || !marched || std::fabs(a.t - b.t) > static_cast<float>(error) * a.t) {
        ++missed;
        continue;
      }
      ++both;
      off += static_cast<double>(std::fabs(a.t - b.t) / a.t);
    }
    off /= both;
    // Linear interpolation makes the error fall with the square of the step on smooth ground.
    EXPECT_LT(off, last_off / 4) << error;
    EXPECT_LT(missed, last_missed / 2) << error;
    EXPECT_LT(off, error / 8);
    last_off = off;
    last_missed = missed;
  }
  EXPECT_GT(last_missed, 0) << "the bounds of production miss nothing, steps do";
}

TEST(Qaeb, PictureMatchesProduction) {
  Scene scene = tessera::testing::empty_scene();
  scene.meshes = shape_scene(make_terrain(landscape(Pattern::ridged, 1, 0.004), 0)).meshes;
  std::vector<Primitive> surface(1);
  surface[0].material =
      tessera::testing::add_material(&scene, tessera::testing::lambert({0.5f, 0.5f, 0.5f}));
  scene.meshes[0].primitives = surface;
  place(scene, 0);
  tessera::testing::set_constant_sky(&scene, 0.2f);
  PunctualLight sun;
  sun.kind = PunctualLight::Kind::directional;
  sun.direction = {0.8f, -0.4f, -0.3f};
  sun.intensity = {3, 3, 3};
  scene.lights.push_back(sun);
  tessera::testing::look_at(&scene, kEye, {0.5, 0.3, 0});
  const auto settings = tessera::testing::small_settings(48, 27, 8);
  const auto exact = tessera::testing::render_picture(scene, settings);
  const auto differs_by = [&](double error) {
    const TraceOptions tracing(best_isa(), [error](const Scene& of) {
      return std::make_unique<const QaebTerrain>(of, kEye, error, 0.01);
    });
    const auto marched = tessera::testing::render_picture(scene, settings, tracing);
    double sum = 0;
    for (std::size_t i = 0; i < exact.rgb.size(); ++i) {
      sum += std::fabs(marched.rgb[i] - exact.rgb[i]);
    }
    return sum / static_cast<double>(exact.rgb.size()) / exact.mean();
  };
  const double coarse = differs_by(1.0 / 32), fine = differs_by(1.0 / 256);
  EXPECT_LT(fine, coarse / 2);
  EXPECT_LT(fine, 0.05);
}

}  // namespace
}  // namespace tessera::render::testing
