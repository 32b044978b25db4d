// Hard case 25: intersections of lines with height fields.

#include <gtest/gtest.h>

#include <cmath>

#include "tests/numeric/shapes/solid_scenes.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/shape_surface.h"
#include "worker/sampling/gradient_noise.h"
#include "worker/shading/texture/procedural_texture.h"

namespace tessera::render::testing {
namespace {

using Pattern = TerrainForm::Pattern;

TerrainForm form_of(Pattern pattern, std::int32_t octaves) {
  TerrainForm form;
  form.pattern = pattern;
  form.size = {4, 3};
  form.height = 0.75;
  form.scale = 1.5;
  form.offset = {0.25, 7.5};
  form.octaves = octaves;
  form.seed = 25;
  return form;
}

/// Terrains of every pattern, with and without detail.
std::vector<TerrainForm> forms() {
  std::vector<TerrainForm> out;
  for (const Pattern pattern : {Pattern::fbm, Pattern::ridged, Pattern::waves}) {
    TerrainForm form = form_of(pattern, 5);
    out.push_back(form);
    form.spot_angle = 0.04;
    form.seen_from = {-1, 1, 2};
    out.push_back(form);
  }
  return out;
}

/// A random point of the rectangle.
Vec2d place_in(const TerrainForm& form, Dice& dice) {
  const double x = 0.5 * static_cast<double>(dice.both());
  return {x * form.size.x, 0.5 * static_cast<double>(dice.both()) * form.size.y};
}

/// A random point on the ground.
Vec3d on_ground(const TerrainField& field, Dice& dice) {
  const Vec2d at = place_in(field.form(), dice);
  return {at.x, field.height(at), at.y};
}

TEST(Terrain, WaveHitsAreExact) {
  TerrainForm form;
  form.pattern = Pattern::waves;
  form.size = {8, 8};
  form.height = 0.2;  // 0.1 + 0.1 sin(2 pi x) where z is 0
  form.octaves = 1;
  const Shape waves = make_terrain(form, 0);
  std::vector<double> ahead;
  for (const ShapeHit& hit : hits_of(waves, {0.5, 0.15, 0}, {1, 0, 0})) {
    if (hit.t > 0) ahead.push_back(hit.t + 0.5);
  }
  ASSERT_EQ(ahead.size(), 6u);
  EXPECT_NEAR(ahead[0], 1.0833333333333333, 1e-12);
  EXPECT_NEAR(ahead[1], 1.4166666666666667, 1e-12);
  // Just below the crest the ray hits, above it misses.
  EXPECT_EQ(hits_of(waves, {0, 0.2 - 1e-6, 0}, {1, 0, 0}).size(), 16u);
  EXPECT_EQ(hits_of(waves, {0, 0.2 + 1e-9, 0}, {1, 0, 0}).size(), 0u);
}

/// Heights far below the rounding of a position at the camera's distance, and a plane.
TEST(Terrain, AlmostFlatGroundIsHitOnceAndLeft) {
  for (const double height : {1e-3, 1e-7, 1e-10, 1e-14, 0.0}) {
    TerrainForm form = form_of(Pattern::ridged, height > 0 ? 8 : 0);
    form.size = {10, 10};
    form.height = height > 0 ? height : 1e-10;
    const Shape ground = make_terrain(form, 0);
    Dice dice(26);
    for (int i = 0; i < 2'000; ++i) {
      const Vec2d at = place_in(form, dice);
      const Vec3d origin = {0.1, 1.5, 5}, target = {at.x, 0, at.y};
      const std::vector<ShapeHit> hits = hits_of(ground, origin, target - origin);
      ASSERT_EQ(hits.size(), 1u) << height;
      const Vec3d& p = hits[0].point;
      ASSERT_EQ(p.y, ground.terrain->height({p.x, p.z}));
      const Vec3f rounded(p);
      const Vec3f normal = Vec3f(normalize(shape_normal(ground, kCurvedFace, Vec3d(rounded))));
      const SurfacePoint surface = placed_shape_point({}, rounded, normal);
      const Vec3f away = normalize(Vec3f{dice.both(), 0.01f + std::fabs(dice.both()), dice.both()});
      std::vector<ShapeHit> again;
      intersect_shape(ground, Vec3d(offset_ray_origin(surface, away)), Vec3d(away), again,
                      {0, 1e9});
      ASSERT_TRUE(again.empty()) << height;
    }
  }
}

TEST(Terrain, NoHitOfFineSteppingIsMissed) {
  Dice dice(25);
  int roots = 0, missed = 0, off = 0;
  for (const TerrainForm& form : forms()) {
    const Shape shape = make_terrain(form, 0);
    const TerrainField& field = *shape.terrain;
    const double finest = 1 / (form.scale * 16);  // the fifth octave's feature
    for (int i = 0; i < 60; ++i) {
      const Vec3d origin = on_ground(field, dice);
      Vec3d direction(dice.direction());
      direction.y *= 0.2;
      direction = direction / std::sqrt(direction.x * direction.x + direction.z * direction.z);
      const auto above = [&](double t) {
        const Vec3d p = origin + direction * t;
        return p.y - field.height({p.x, p.z});
      };
      const auto found = hits_of(shape, origin, direction);
      double last = -1e9;
      for (const ShapeHit& hit : found) {
        EXPECT_GE(hit.t, last);
        last = hit.t;
        off += std::fabs(above(hit.t)) <= 1e-12 ? 0 : 1;
      }
      const double step = finest / 16;
      double let_go = -1e9;  // a root that may be missed, as in a pair
      const int steps = static_cast<int>(5 / step);
      for (int k = -steps; k < steps; ++k) {
        const double t = k * step;
        const Vec3d p = origin + direction * t, q = origin + direction * (t + step);
        if (!shape.clip.contains(p) || !shape.clip.contains(q)) continue;
        double low = t, high = t + step;
        const bool over = above(low) > 0;
        if (over == (above(high) > 0)) continue;
        for (int n = 0; n < 50; ++n) {
          const double middle = 0.5 * (low + high);
          ((above(middle) > 0) == over ? low : high) = middle;
        }
        ++roots;
        bool met = false;
        for (const ShapeHit& hit : found) {
          met = met || (std::fabs(hit.t - low) < 1e-8 && hit.enters == over);
        }
        if (met) continue;
        ++missed;
        const double apart = (low - let_go) * length(direction);
        if (form.spot_angle > 0 && apart <= field.precision({p.x, p.z})) missed -= 2;
        let_go = low;
      }
    }
  }
  EXPECT_GT(roots, 500);
  EXPECT_EQ(missed, 0);
  EXPECT_EQ(off, 0);
}

TEST(Terrain, HeightsMatchTexture) {
  Dice dice(1);
  for (const TerrainForm& form : forms()) {
    if (form.pattern == Pattern::waves) continue;
    const TerrainField field(form);
    ProceduralTexture same;
    same.pattern = form.pattern == Pattern::fbm ? ProceduralTexture::Pattern::fbm
                                                : ProceduralTexture::Pattern::ridged;
    same.dimensions = 2;
    same.octaves = form.octaves;
    same.seed = form.seed;
    for (int i = 0; i < 5'000; ++i) {
      const Vec2d at = place_in(form, dice);
      const Vec2d p = at * form.scale + form.offset;
      const double spot = form.spot_angle * length(Vec3d{at.x, 0, at.y} - form.seen_from);
      const float expected =
          pattern_at(same, {p.x, p.y, 0, 0}, static_cast<float>(spot * form.scale));
      EXPECT_NEAR(field.height(at), form.height * static_cast<double>(expected), 4e-6);
    }
  }
}

TEST(Terrain, BoundsHoldEveryHeight) {
  Dice dice(2);
  int tight = 0, all = 0;
  for (const TerrainForm& form : forms()) {
    const TerrainField field(form);
    TerrainCells cells;  // for one seed
    for (int i = 0; i < 3'000; ++i) {
      const Vec2d at = place_in(form, dice);
      const double size = std::pow(10.0, -4 * static_cast<double>(dice.unit()));
      const Vec3f turn = dice.direction();
      const double along = std::sqrt(double{turn.x * turn.x + turn.y * turn.y});
      const Vec2d u = {double{turn.x} / along, double{turn.y} / along}, v = {-u.y, u.x};
      const AffineForm<2> both = field.heights<2>(at, {u * size, v * (0.7 * size)}, cells);
      const AffineForm<1> one = field.heights<1>(at, {u * size}, cells);
      for (int k = 0; k < 20; ++k) {
        const auto s = static_cast<double>(dice.both()), t = static_cast<double>(dice.both());
        const double h = field.height(at + u * (s * size) + v * (t * 0.7 * size));
        EXPECT_LE(std::fabs(h - both.centre - both.slope[0] * s - both.slope[1] * t), both.error);
        const double on = field.height(at + u * (s * size));
        EXPECT_LE(std::fabs(on - one.centre - one.slope[0] * s), one.error);
        tight += std::fabs(on - one.centre - one.slope[0] * s) > 0.2 * one.error ? 1 : 0;
        ++all;
      }
    }
    const std::size_t across = std::size_t{1} << (field.levels() - 1);
    for (int i = 0; i < 20'000; ++i) {
      const Vec2d at = place_in(form, dice);
      const auto cell = [&](double x, double size) {
        return static_cast<std::size_t>((x / size + 0.5) * static_cast<double>(across));
      };
      const auto& range =
          field.range(field.levels() - 1, cell(at.x, form.size.x), cell(at.y, form.size.y));
      const double h = field.height(at);
      EXPECT_LE(double{range.low}, h);
      EXPECT_GE(double{range.high}, h);
    }
  }
  EXPECT_GT(tight, all / 50);  // the bounds are tight
}

TEST(Terrain, NoiseCurvatureStaysWithinBound) {
  Dice dice(3);
  double largest = 0;
  NoiseCell cell;
  for (int i = 0; i < 400'000; ++i) {
    const std::array<double, 2> p = {1e3 * static_cast<double>(dice.both()),
                                     1e3 * static_cast<double>(dice.both())};
    const NoiseSlope here = gradient_noise_slope(p, 9, cell);
    if (i % 100 == 0) {
      EXPECT_NEAR(here.value, double{gradient_noise(std::array<double, 2>{p}, 9)}, 1e-6);
    }
    const Vec3f turn = dice.direction();
    const double along = std::sqrt(double{turn.x * turn.x + turn.y * turn.y}), h = 1e-5;
    const double ux = double{turn.x} / along, uy = double{turn.y} / along;
    const NoiseSlope next = gradient_noise_slope({p[0] + h * ux, p[1] + h * uy}, 9, cell);
    const double slope = 0.5 * ((here.dx + next.dx) * ux + (here.dy + next.dy) * uy);
    EXPECT_NEAR((next.value - here.value) / h, slope, 1e-6);
    largest = std::max(largest, std::fabs((next.dx - here.dx) * ux + (next.dy - here.dy) * uy) / h);
  }
  EXPECT_LE(largest, kNoiseCurvature);
  EXPECT_GT(largest, 0.8 * kNoiseCurvature);
}

TEST(Terrain, ZeroOctavesIsAPlane) {
  for (const Pattern pattern : {Pattern::fbm, Pattern::ridged}) {
    const Shape plane = make_terrain(form_of(pattern, 0), 0.5);
    const double level = pattern == Pattern::fbm ? 0.375 : 0;
    const auto down = hits_of(plane, {1, 5, -1}, {0, -2, 0});
    ASSERT_EQ(down.size(), 2u);
    EXPECT_NEAR(down[0].t, (5 - level) / 2, 1e-15);
    EXPECT_EQ(down[0].face, kCurvedFace);
    EXPECT_EQ(shape_normal(plane, kCurvedFace, down[0].point), (Vec3d{0, 1, 0}));
    EXPECT_EQ(down[1].t, 2.75);  // the floor
    EXPECT_EQ(down[1].face, 3u);
    // In through a side, and out through the ground.
    const auto up = hits_of(plane, {-4, level - 1, 0}, {1, 0.25, 0});
    ASSERT_EQ(up.size(), 2u);
    EXPECT_TRUE(up[0].enters);
    EXPECT_NEAR(up[1].t, 4, 1e-14);
    EXPECT_FALSE(up[1].enters);
    EXPECT_TRUE(hits_of(plane, {-4, level + 0.01, 0}, {1, 0, 0.1}).empty());
  }
}

TEST(Terrain, LatticePointsHavePatternValue) {
  TerrainForm form = form_of(Pattern::fbm, 4);
  form.scale = 1;
  form.offset = {};
  const TerrainField fbm(form);  // noise is 0 there, in every octave
  for (int x = -2; x <= 2; ++x) EXPECT_EQ(fbm.height({static_cast<double>(x), 1}), 0.375);
  form.pattern = Pattern::ridged;
  form.octaves = 1;
  const TerrainField ridged(form);  // and a crest
  for (int x = -2; x <= 2; ++x) EXPECT_EQ(ridged.height({static_cast<double>(x), 1}), 0.75);
  form.pattern = Pattern::waves;
  const TerrainField waves(form);
  Dice dice(4);
  for (int i = 0; i < 1'000; ++i) {
    const Vec2d at = place_in(form, dice);
    const double h = waves.height(at);
    EXPECT_NEAR(waves.height({at.x + 1, at.y - 1}), h, 1e-14);
    EXPECT_NEAR(waves.height({-at.x, at.y}), 0.75 - h, 1e-14);
    EXPECT_NEAR(waves.height({at.x, -at.y}), h, 1e-14);
    EXPECT_NEAR(
        waves.height(at),
        0.375 + 0.375 * std::sin(6.283185307179586 * at.x) * std::cos(6.283185307179586 * at.y),
        1e-14);
  }
}

TEST(Terrain, GroundDoesNotLeak) {
  Dice dice(5);
  int through = 0, crossings = 0;
  for (const TerrainForm& form : forms()) {
    const Shape shape = make_terrain(form, 0);
    for (int i = 0; i < 3'000; ++i) {
      // From above to below, some along the planes and edges of cells.
      const Vec2d a = place_in(form, dice), b = place_in(form, dice);
      Vec3d from = {a.x, form.height, a.y}, to = {b.x, 0, b.y};
      if (i % 3 == 0) from.x = to.x = form.size.x * (dice.below(33) / 32.0 - 0.5);
      if (i % 4 == 0) from.z = to.z = form.size.y * (dice.below(33) / 32.0 - 0.5);
      const auto hits = hits_of(shape, from, to - from);
      bool inside = false;
      for (const ShapeHit& hit : hits) {
        EXPECT_NE(hit.enters, inside);
        inside = hit.enters;
      }
      crossings += static_cast<int>(hits.size());
      through += inside && hits.front().t >= 0 && hits.back().t <= 1 ? 0 : 1;
    }
  }
  EXPECT_EQ(through, 0);
  EXPECT_GT(crossings, 6 * 3'000);
}

TEST(Terrain, NormalsMatchCentralDifferences) {
  Dice dice(6);
  for (const TerrainForm& form : forms()) {
    const Shape shape = make_terrain(form, 0);
    const TerrainField& field = *shape.terrain;
    int off = 0;
    for (int i = 0; i < 2'000; ++i) {
      const Vec2d at = place_in(form, dice);
      const double h = 1e-6;
      const Vec3d expected = {
          -(field.height({at.x + h, at.y}) - field.height({at.x - h, at.y})) / (2 * h), 1,
          -(field.height({at.x, at.y + h}) - field.height({at.x, at.y - h})) / (2 * h)};
      const Vec3d normal = shape_normal(shape, kCurvedFace, {at.x, field.height(at), at.y});
      off += length(normal - expected) <= 1e-4 * length(expected) ? 0 : 1;
    }
    EXPECT_LE(off, 2);  // where a crest or the limit of a weight is near
  }
}

TEST(Terrain, UpwardRaysDoNotHitAgain) {
  Dice dice(7);
  int again = 0, left = 0;
  for (const TerrainForm& form : forms()) {
    const Shape shape = make_terrain(form, 0);
    for (int i = 0; i < 1'500; ++i) {
      const double size = std::pow(10.0, i % 4 * 3 - 3), offset = i / 4 % 2 == 0 ? 0 : size * 1e3;
      Affine3d at = scaled(Vec3d{1, 1, 1} * size);
      at.translation = Vec3d(dice.direction()) * offset;
      const Scene scene = shape_scene(shape, at);
      const Vec2d down = place_in(form, dice);
      Ray ray;
      ray.origin = Vec3f(transform_point(at, {down.x, 3, down.y}));
      ray.direction = Vec3f(dice.vector() * 0.3f) - Vec3f{0, 1, 0};
      Hit hit;
      if (!brute_force_closest(scene, ray, hit)) continue;
      const Vec3d local = {hit.b0, hit.b1, hit.b2};
      const Vec3f normal(normalize(
          transform_normal(scene.instances[0].world_to_object,
                           shape_normal(*scene.meshes[0].shape, hit.id.triangle, local))));
      const SurfacePoint point = placed_shape_point(at, Vec3f(local), normal);
      ++left;
      again += brute_force_closest(scene, spawn_ray(point, hit.id, {0, 1, 0}), hit) ? 1 : 0;
    }
  }
  EXPECT_EQ(again, 0);
  EXPECT_GT(left, 6'000);
}

}  // namespace
}  // namespace tessera::render::testing
