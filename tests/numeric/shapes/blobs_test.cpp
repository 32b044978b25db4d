// Hard case 24: intersections of lines with blobs.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/numeric/shapes/solid_scenes.h"
#include "worker/geometry/shapes/blobs/blob_line.h"
#include "worker/geometry/shapes/intersect_shape.h"
#include "worker/geometry/shapes/shape_surface.h"

namespace tessera::render::testing {
namespace {

constexpr Vec3d kUnit = {1, 1, 1};

/// Two blobs of radius 1 at this distance along x.
Shape pair_apart(double distance) {
  const Vec3d half = {distance / 2, 0, 0};
  return make_blobs({{-half, kUnit, 1}, {half, kUnit, 1}}, 0.25);
}

/// An independent implementation of the field.
double field(const std::vector<Blob>& blobs, const Vec3d& p) {
  double sum = 0;
  for (const Blob& blob : blobs) {
    double r2 = 0;
    for (int k = 0; k < 3; ++k) {
      const double x = (p[k] - blob.centre[k]) / blob.radii[k];
      r2 += x * x;
    }
    if (r2 < 1) sum += blob.strength * (1 - r2) * (1 - r2);
  }
  return sum;
}

/// Blobs of all sizes and both signs in and around [-1, 1]^3.
std::vector<Blob> random_blobs(Dice& dice) {
  std::vector<Blob> blobs(1 + dice.below(40));
  for (Blob& blob : blobs) {
    blob.centre = Vec3d(dice.vector());
    for (int k = 0; k < 3; ++k) blob.radii[k] = 0.1 + 0.5 * static_cast<double>(dice.unit());
    blob.strength = static_cast<double>(dice.unit()) * (dice.below(4) == 0 ? -2 : 2);
  }
  return blobs;
}

/// `count` blobs of radius 1 with centres within 0.3 of the origin along each axis: all overlap.
std::vector<Blob> dense_blobs(Dice& dice, std::size_t count) {
  std::vector<Blob> blobs(count);
  for (Blob& blob : blobs) blob = {Vec3d(dice.vector()) * 0.3, kUnit, 1};
  return blobs;
}

/// Blobs with radii over `octaves` octaves, so that some are much smaller than others; one in
/// `negative` has a negative strength.
std::vector<Blob> mixed_blobs(Dice& dice, std::size_t count, int octaves, std::uint32_t negative) {
  std::vector<Blob> blobs(count);
  for (Blob& blob : blobs) {
    const double size =
        std::ldexp(1.0, -static_cast<int>(dice.below(static_cast<std::uint32_t>(octaves))));
    blob.centre = Vec3d(dice.vector());
    for (int k = 0; k < 3; ++k) blob.radii[k] = size * (0.5 + static_cast<double>(dice.unit()));
    blob.strength = static_cast<double>(dice.unit()) * (dice.below(negative) == 0 ? -2 : 2);
  }
  return blobs;
}

/// `count` small blobs in 20 clusters.
std::vector<Blob> clustered_blobs(Dice& dice, std::size_t count) {
  std::vector<Vec3d> clusters(20);
  for (Vec3d& cluster : clusters) cluster = Vec3d(dice.vector());
  std::vector<Blob> blobs(count);
  for (Blob& blob : blobs) {
    blob.centre = clusters[dice.below(20)] + Vec3d(dice.vector()) * 0.02;
    blob.radii = kUnit * (0.02 + 0.05 * static_cast<double>(dice.unit()));
  }
  return blobs;
}

/// The field minus the threshold at a point of a line, and how far rounding may move it.
struct Level {
  double value = 0, error = 0;
};

/// u is 2^-53. A cell sums n blobs over at most 200 halvings, in 49 products of at most 1 times the
/// strengths; each blob is rounded by at most 64 u before that, and each halving adds at most 12 u.
/// The plain search sums n. A point of the line is rounded by less than 8 u of its distances, which
/// moves the field of a blob by at most 4 times as much of its radius.
Level level_at(const std::vector<Blob>& blobs, double threshold, const Vec3d& origin,
               const Vec3d& direction, double t) {
  const Vec3d p = origin + direction * t;
  const double size = 2 * (length(origin) + length(direction) * std::fabs(t)) + 1;
  double strengths = threshold, moved = 0, sum = 0;
  for (const Blob& blob : blobs) {
    const Vec3d q = (p - blob.centre) / blob.radii;
    const double left = 1 - dot(q, q);
    const double least = std::min({blob.radii.x, blob.radii.y, blob.radii.z});
    if (left < -64 * 0x1p-53 * size / least) continue;
    strengths += std::fabs(blob.strength);
    moved += std::fabs(blob.strength) * size / least;
    if (left > 0) sum += blob.strength * left * left;
  }
  const double n = static_cast<double>(blobs.size());
  return {sum - threshold, 0x1p-53 * (49 * (n + 64 + 200 * 12) * strengths + 32 * moved)};
}

std::size_t hits_before(const std::vector<ShapeHit>& hits, double t) {
  return static_cast<std::size_t>(
      std::count_if(hits.begin(), hits.end(), [&](const ShapeHit& hit) { return hit.t < t; }));
}

/// Shoots lines at the blobs. All hits must lie on the surface, and between hits a line must be on
/// the same side of it as the plain search says, both up to rounding. Returns the number of hits.
std::size_t compare_with_plain(Dice& dice, const std::vector<Blob>& blobs, double threshold,
                               int lines) {
  const BlobField field(blobs, threshold);
  BlobLine fast, plain;
  std::vector<ShapeHit> found, expected, all;
  std::size_t count = 0;
  for (int i = 0; i < lines; ++i) {
    const Vec3d origin = Vec3d(dice.direction()) * 4.0;
    const Vec3d direction = Vec3d(dice.vector()) * 1.2 - origin;
    found.clear();
    expected.clear();
    fast.intersect(field, origin, direction, {}, found);
    plain.intersect_plain(field, origin, direction, expected);
    count += found.size();
    EXPECT_EQ(found.size() % 2, 0u);
    const auto level = [&](double t) { return level_at(blobs, threshold, origin, direction, t); };
    for (std::size_t k = 0; k < found.size(); ++k) {
      EXPECT_EQ(found[k].enters, k % 2 == 0) << i;
      EXPECT_LE(std::fabs(level(found[k].t).value), level(found[k].t).error) << i;
    }
    all = found;
    all.insert(all.end(), expected.begin(), expected.end());
    std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.t < b.t; });
    for (std::size_t k = 0; k + 1 < all.size(); ++k) {
      const double t = 0.5 * (all[k].t + all[k + 1].t);
      const bool inside = hits_before(found, t) % 2 == 1;
      const Level here = level(t);
      if (std::fabs(here.value) <= here.error) continue;
      EXPECT_EQ(inside, hits_before(expected, t) % 2 == 1) << i;
      EXPECT_EQ(inside, here.value > 0) << i;
    }
  }
  return count;
}

TEST(Blobs, DenseHitsMatchPlainSearch) {
  Dice dice(31);
  std::size_t hits = 0;
  for (int scene = 0; scene < 30; ++scene) {
    const std::size_t size = 20 + dice.below(400);
    hits += compare_with_plain(dice, dense_blobs(dice, size), static_cast<double>(size) / 16, 20);
  }
  hits += compare_with_plain(dice, dense_blobs(dice, 3'000), 3'000 / 16.0, 4);
  EXPECT_GT(hits, 500u);
}

TEST(Blobs, MixedSignsMatchPlainSearch) {
  Dice dice(34);
  std::size_t hits = 0;
  for (int scene = 0; scene < 30; ++scene) {
    const std::size_t size = 20 + dice.below(400);
    hits += compare_with_plain(dice, mixed_blobs(dice, size, 4, 4), 0.25, 20);
    hits += compare_with_plain(dice, mixed_blobs(dice, size, 16, 2), 1e-6, 20);
    std::vector<Blob> blobs = dense_blobs(dice, size);
    for (std::size_t i = 0; i < size; i += 3) blobs[i].strength = -1;
    hits += compare_with_plain(dice, blobs, static_cast<double>(size) / 64, 20);
  }
  EXPECT_GT(hits, 3'000u);
}

TEST(Blobs, ClusteredHitsMatchPlainSearch) {
  Dice dice(35);
  std::size_t hits = 0;
  for (const double threshold : {0.25, 2.0}) {
    hits += compare_with_plain(dice, clustered_blobs(dice, 2'000), threshold, 500);
  }
  EXPECT_GT(hits, 50u);
}

TEST(Blobs, SparseHitsMatchPlainSearch) {
  Dice dice(36);
  std::vector<Blob> blobs = mixed_blobs(dice, 5'000, 1, 10);
  for (Blob& blob : blobs) blob.radii = blob.radii * 0.05;
  EXPECT_GT(compare_with_plain(dice, blobs, 0.25, 300), 1'000u);
}

TEST(Blobs, TouchedThresholdMatchesPlainSearch) {
  // The pairs cancel up to rounding, which leaves a field of 3 around the origin.
  std::vector<Blob> blobs = {
      {{}, kUnit, 1}, {{}, kUnit * std::sqrt(2.0), -6}, {{}, kUnit * 2.0, 8}};
  Dice dice(32);
  for (int i = 0; i < 40; ++i) {
    const Blob blob = {Vec3d(dice.vector()), kUnit, static_cast<double>(dice.unit())};
    blobs.push_back(blob);
    blobs.push_back({blob.centre, blob.radii, -blob.strength});
  }
  EXPECT_GT(compare_with_plain(dice, blobs, 3, 500), 500u);
}

TEST(Blobs, RequestedHitsAreThoseOfTheLine) {
  Dice dice(37);
  BlobLine line;
  std::vector<ShapeHit> all, found;
  for (int scene = 0; scene < 40; ++scene) {
    const BlobField field(mixed_blobs(dice, 10 + dice.below(300), 5, 4), 0.25);
    for (int i = 0; i < 50; ++i) {
      const Vec3d origin = Vec3d(dice.vector()) * 2.0, direction = Vec3d(dice.vector());
      const double from = static_cast<double>(dice.unit()) - 0.5;
      const double to = from + static_cast<double>(dice.unit());
      const auto requested = [&](const ShapeHit& hit) { return hit.t >= from && hit.t <= to; };
      for (const bool first : {false, true}) {
        all.clear();
        found.clear();
        line.intersect(field, origin, direction, {}, all);
        line.intersect(field, origin, direction, {from, to, first}, found);
        std::erase_if(all, [&](const ShapeHit& hit) { return !requested(hit); });
        std::erase_if(found, [&](const ShapeHit& hit) { return !requested(hit); });
        if (first && all.size() > 1) all.resize(1);
        ASSERT_EQ(found.size(), all.size()) << scene << ' ' << i;
        for (std::size_t k = 0; k < all.size(); ++k) {
          EXPECT_EQ(found[k].t, all[k].t);
          EXPECT_EQ(found[k].enters, all[k].enters);
        }
      }
    }
  }
}

TEST(Blobs, DenseLineVisitsFewOfManyBlobs) {
  Dice dice(33);
  for (const std::size_t count : {400u, 1'600u, 6'400u}) {
    const BlobField field(dense_blobs(dice, count), static_cast<double>(count) / 16);
    const auto root = static_cast<std::size_t>(std::sqrt(static_cast<double>(count)));
    BlobLine line;
    std::vector<ShapeHit> hits;
    std::size_t visits = 0;
    for (int i = 0; i < 100; ++i) {
      const Vec3d origin = Vec3d(dice.direction()) * 4.0;
      line.intersect(field, origin, Vec3d(dice.vector()) - origin, {}, hits);
      visits += line.visit_count();
    }
    EXPECT_GT(hits.size(), 100u);
    EXPECT_LE(visits, 100 * 60 * root) << count;
  }
}

/// Blobs visited per camera ray, and per shadow ray from where a camera ray hit.
std::array<double, 2> visits_of_paths(const std::vector<Blob>& blobs, double threshold) {
  const BlobField field(blobs, threshold);
  Dice dice(40);
  BlobLine line;
  std::vector<ShapeHit> hits;
  std::size_t camera = 0, shadow = 0, hit = 0;
  for (int i = 0; i < 400; ++i) {
    const Vec3d origin = Vec3d(dice.direction()) * 4.0;
    hits.clear();
    line.intersect(field, origin, Vec3d(dice.vector()) * 0.5 - origin, {0, 1e9, true}, hits);
    camera += line.visit_count();
    if (hits.empty()) continue;
    const Vec3d out = field.outward_gradient(hits.back().point);
    const Vec3d start = hits.back().point + out * (1e-6 / length(out));
    const Vec3d lamp = Vec3d(dice.direction()) * 0.9 + out * (1 / length(out));
    line.intersect(field, start, lamp, {0, 1e9, true}, hits);
    shadow += line.visit_count();
    ++hit;
  }
  EXPECT_GT(hit, 300u);
  return {static_cast<double>(camera) / 400,
          static_cast<double>(shadow) / static_cast<double>(hit)};
}

/// A cell lists the blobs whose surface passes through it. Four times as many blobs allow cells of
/// half the size, so the list, which a ray visits about once, grows twofold.
TEST(Blobs, VisitsOfPathsGrowWithRootOfDenseBlobs) {
  Dice dice(41);
  for (const std::size_t count : {400u, 1'600u, 6'400u}) {
    const double root = std::sqrt(static_cast<double>(count));
    const auto [camera, shadow] =
        visits_of_paths(dense_blobs(dice, count), static_cast<double>(count) / 16);
    EXPECT_LE(camera, 15 * root) << count;
    EXPECT_LE(shadow, 15 * root) << count;
  }
}

TEST(Blobs, ManyBlobsHaveExactNormals) {
  Dice dice(38);
  const std::vector<Blob> blobs = mixed_blobs(dice, 300, 4, 4);
  const Shape shape = make_blobs(blobs, 0.25);
  int checked = 0;
  for (int i = 0; i < 1'000; ++i) {
    const Vec3d origin = Vec3d(dice.vector()) * 3.0;
    for (const ShapeHit& hit : hits_of(shape, origin, Vec3d(dice.vector()) - origin)) {
      Vec3d sum;
      double size = 0;
      for (const Blob& blob : blobs) {
        const Vec3d p = (hit.point - blob.centre) / blob.radii;
        const double left = 1 - dot(p, p);
        if (!(left > 0)) continue;
        sum += p / blob.radii * (4 * blob.strength * left);
        size += length(p / blob.radii * (4 * blob.strength));
      }
      EXPECT_LE(length(shape.blobs->outward_gradient(hit.point) - sum), 1e-12 * size);
      EXPECT_TRUE(shape.bounds.contains(Vec3f(hit.point)));
      ++checked;
    }
  }
  EXPECT_GT(checked, 500);
}

TEST(Blobs, PolynomialOfSmallBoxHasTightRange) {
  Dice dice(39);
  for (int i = 0; i < 500; ++i) {
    const Vec3d half = {0.02, 0.01, 0.03};
    std::vector<Blob> blobs = dense_blobs(dice, 1 + dice.below(20));
    BlobPolynomial sum;
    for (std::size_t k = 0; k < blobs.size(); ++k) {
      if (k % 4 == 3) blobs[k].strength = -1;
      sum.add({blobs[k].centre, kUnit, blobs[k].strength}, half, half * 2.0);
    }
    // The box from 0 to 2 * half within that from -half to 3 * half.
    for (int axis = 0; axis < 3; ++axis) sum.take_half(axis, true);
    for (int axis = 0; axis < 3; ++axis) sum.take_half(axis, false);
    // Now that from half to 2 * half.
    const FieldRange range = sum.range();
    double low = 1e9, high = -1e9;
    for (int corner = 0; corner < 8; ++corner) {
      Vec3d p = {-1, -1, -1};
      for (int k = 0; k < 3; ++k) p[k] += 2 * ((corner >> k) & 1);
      const double value = field(blobs, half * 1.5 + half * p * 0.5);
      low = std::min(low, value);
      high = std::max(high, value);
      EXPECT_NEAR(sum.along(p, {})[0], value, 1e-12);
    }
    EXPECT_LE(range.low, low + 1e-12);
    EXPECT_GE(range.high, high - 1e-12);
    EXPECT_LE(range.high - range.low,
              1.1 * (high - low) + 0.01 * static_cast<double>(blobs.size()));
  }
}

TEST(Blobs, SingleBlobIsASphere) {
  const Shape blob = make_blobs({{{}, kUnit, 1}}, 0.25);
  const auto through = hits_of(blob, {0, 0, -3}, {0, 0, 1});
  ASSERT_EQ(through.size(), 2u);
  EXPECT_NEAR(through[0].t, 2.2928932, 1e-7);
  EXPECT_NEAR(through[1].t, 3.7071068, 1e-7);

  const double radius = std::sqrt(0.5);  // (1 - r^2)^2 = 1 / 4
  const Shape sphere = make_ellipsoid(kUnit * radius);
  EXPECT_NEAR(blob.bounds.hi.x, radius, 1e-7);
  Dice dice(24);
  int hit = 0;
  for (int i = 0; i < 20'000; ++i) {
    const double distance = std::pow(10.0, i % 4);
    const Vec3d origin = Vec3d(dice.direction()) * distance;
    const Vec3d direction = Vec3d(dice.direction()) * 0.9 - origin;
    const auto expected = hits_of(sphere, origin, direction);
    const auto found = hits_of(blob, origin, direction);
    // A nearly tangent ray may hit or miss.
    if (expected.size() == 2 && expected[1].t - expected[0].t < 1e-6 / distance) continue;
    ASSERT_EQ(found.size(), expected.size()) << i;
    for (std::size_t k = 0; k < found.size(); ++k) {
      ++hit;
      EXPECT_LE(length(found[k].point - expected[k].point), 1e-10 * distance);
      EXPECT_EQ(found[k].enters, expected[k].enters);
    }
  }
  EXPECT_GT(hit, 15'000);
}

TEST(Blobs, NeckBetweenTwoIsExact) {
  const auto crossings = [](double distance, double height) {
    return hits_of(pair_apart(distance), {0, height, -3}, {0, 0, 1}).size();
  };
  EXPECT_EQ(crossings(1.6080, 0.005), 2u);
  EXPECT_EQ(crossings(1.6080, 0.006), 0u);
  EXPECT_EQ(crossings(1.6080380, 0), 2u);
  EXPECT_EQ(crossings(1.6080382, 0), 0u);
  // Along x: one interval through the neck, or one for each blob.
  EXPECT_EQ(hits_of(pair_apart(1.608), {-3, 0, 0}, {1, 0, 0}).size(), 2u);
  EXPECT_EQ(hits_of(pair_apart(1.609), {-3, 0, 0}, {1, 0, 0}).size(), 4u);
}

TEST(Blobs, DistantBlobsAreSpheres) {
  const Shape both = pair_apart(3);
  const Shape sphere = make_ellipsoid(kUnit * std::sqrt(0.5));
  Dice dice(25);
  int hit = 0;
  for (int i = 0; i < 10'000; ++i) {
    const Vec3d origin = Vec3d(dice.vector()) * 4.0, direction(dice.direction());
    std::vector<double> expected;
    for (const double x : {-1.5, 1.5}) {
      for (const ShapeHit& h : hits_of(sphere, origin - Vec3d{x, 0, 0}, direction)) {
        expected.push_back(h.t);
      }
    }
    std::sort(expected.begin(), expected.end());
    const auto found = hits_of(both, origin, direction);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t k = 0; k < found.size(); ++k) EXPECT_NEAR(found[k].t, expected[k], 1e-7);
    hit += static_cast<int>(found.size());
  }
  EXPECT_GT(hit, 1'000);
}

TEST(Blobs, RootsMatchDenseBisection) {
  constexpr int kSteps = 2048;
  Dice dice(26);
  int roots = 0, off = 0, missed = 0, lone = 0;
  for (int i = 0; i < 800; ++i) {
    const std::vector<Blob> blobs = random_blobs(dice);
    const Vec3d origin = Vec3d(dice.vector()) * 3.0, direction = Vec3d(dice.vector()) - origin;
    const auto at = [&](double t) { return field(blobs, origin + direction * t) - 0.25; };
    const auto found = hits_of(make_blobs(blobs, 0.25), origin, direction);
    std::vector<char> seen(found.size(), 0);
    const double step = 1.0 / kSteps;  // from t = -1 to 3
    for (int k = -kSteps; k < 3 * kSteps; ++k) {
      double low = k * step, high = low + step;
      const bool inside = at(low) > 0;
      if (inside == (at(high) > 0)) continue;
      for (int n = 0; n < 60; ++n) {
        const double middle = 0.5 * (low + high);
        ((at(middle) > 0) == inside ? low : high) = middle;
      }
      ++roots;
      bool near = false;
      for (std::size_t h = 0; h < found.size(); ++h) {
        if (std::fabs(found[h].t - low) > 1e-9 || found[h].enters == inside) continue;
        near = true;
        seen[h] = 1;
      }
      missed += near ? 0 : 1;
    }
    // Roots missed by the steps come in pairs closer than a step, and must be roots.
    for (std::size_t h = 0; h < found.size(); ++h) {
      off += std::fabs(at(found[h].t)) <= 1e-12 ? 0 : 1;
      if (seen[h] != 0 || found[h].t < -1 || found[h].t > 3) continue;
      const bool paired = (h > 0 && found[h].t - found[h - 1].t < step) ||
                          (h + 1 < found.size() && found[h + 1].t - found[h].t < step);
      lone += paired ? 0 : 1;
    }
  }
  EXPECT_GT(roots, 500);
  EXPECT_EQ(missed, 0);
  EXPECT_EQ(off, 0);
  EXPECT_EQ(lone, 0);
}

TEST(Blobs, NormalsMatchCentralDifferences) {
  Dice dice(27);
  int checked = 0;
  for (int i = 0; i < 1'500; ++i) {
    const std::vector<Blob> blobs = random_blobs(dice);
    const Shape shape = make_blobs(blobs, 0.25);
    const Vec3d origin = Vec3d(dice.vector()) * 3.0;
    for (const ShapeHit& hit : hits_of(shape, origin, Vec3d(dice.vector()) - origin)) {
      Vec3d slope;
      for (int k = 0; k < 3; ++k) {
        Vec3d h;
        h[k] = 1e-5;
        slope[k] = (field(blobs, hit.point + h) - field(blobs, hit.point - h)) / 2e-5;
      }
      const Vec3d normal = shape_normal(shape, hit.face, hit.point);
      EXPECT_LE(length(normal + slope), 1e-6 * (1 + length(slope)));
      EXPECT_TRUE(shape.bounds.contains(Vec3f(hit.point))) << i;
      ++checked;
    }
  }
  EXPECT_GT(checked, 500);
}

TEST(Blobs, NegativeBlobCancelsPositiveOne) {
  const Blob kept = {{0.25, 0, 0}, {1, 0.5, 0.75}, 1};
  const Blob plus = {{0.5, 0.25, 0}, kUnit, 1.5}, minus = {{0.5, 0.25, 0}, kUnit, -1.5};
  const Shape alone = make_blobs({kept}, 0.25), all = make_blobs({plus, kept, minus}, 0.25);
  Dice dice(28);
  for (int i = 0; i < 2'000; ++i) {
    const Vec3d origin = Vec3d(dice.direction()) * 3.0;
    const Vec3d direction = Vec3d(dice.vector()) * 0.4 - origin;
    const auto expected = hits_of(alone, origin, direction),
               found = hits_of(all, origin, direction);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t k = 0; k < found.size(); ++k) EXPECT_NEAR(found[k].t, expected[k].t, 1e-7);
  }
  EXPECT_TRUE(hits_of(make_blobs({plus, minus}, 0.25), {0, 0, -3}, {0, 0, 1}).empty());
}

TEST(Blobs, ConstantFieldAtThresholdIsClosed) {
  // 1 (1 - x)^2 - 6 (1 - x / 2)^2 + 8 (1 - x / 4)^2 = 3, x being the square of the distance.
  const std::vector<Blob> blobs = {
      {{}, kUnit, 1}, {{}, kUnit * std::sqrt(2.0), -6}, {{}, kUnit * 2.0, 8}};
  EXPECT_NEAR(field(blobs, {0.5, 0.25, -0.125}), 3, 1e-12);
  Dice dice(29);
  for (int i = 0; i < 2'000; ++i) {
    const Vec3d origin = Vec3d(dice.direction()) * 3.0;
    const auto hits = hits_of(make_blobs(blobs, 3), origin, Vec3d(dice.vector()) * 0.5 - origin);
    EXPECT_EQ(hits.size() % 2, 0u);
    for (std::size_t k = 0; k < hits.size(); ++k) {
      EXPECT_EQ(hits[k].enters, k % 2 == 0);
      EXPECT_NEAR(field(blobs, hits[k].point), 3, 1e-12);
    }
  }
}

TEST(Blobs, LimitedPrecisionKeepsSurfaceClosed) {
  const Shape shape = make_blobs({{{}, kUnit, 1}, {{1e15, 0, 0}, kUnit, 1}}, 1e-4);
  Dice dice(30);
  int found = 0;
  for (int i = 0; i < 2'000; ++i) {
    const Vec3d origin = {1e15, 0, 0};
    const auto hits = hits_of(shape, origin, Vec3d(dice.direction()) + Vec3d{3, 0, 0});
    found += hits.empty() ? 0 : 1;
    EXPECT_EQ(hits.size() % 2, 0u);
  }
  EXPECT_GT(found, 500);
}

TEST(Blobs, BoundsAreTight) {
  // Two blobs that overlap a little reach at least as far as each alone.
  const Shape both = pair_apart(1.6);
  EXPECT_GE(both.bounds.hi.x, 0.8f + static_cast<float>(std::sqrt(0.5)));
  EXPECT_LT(both.bounds.hi.x, 1.8f);
  EXPECT_LT(both.bounds.hi.y, static_cast<float>(std::sqrt(1 - std::sqrt(0.125))) + 1e-6f);
  // Two blobs in one place reach further than either alone: 0.6 (1 - r^2)^2 = 0.25.
  const Shape weak = make_blobs({{{}, kUnit, 0.3}, {{}, kUnit, 0.3}}, 0.25);
  EXPECT_NEAR(weak.bounds.hi.x, std::sqrt(1 - std::sqrt(0.25 / 0.6)), 1e-6);
  // Negative blobs do not extend the bounds, and a field below the threshold has bounds, too.
  const Shape one = make_blobs({{{}, kUnit, 1}, {{2, 0, 0}, kUnit * 3.0, -1}}, 0.25);
  EXPECT_NEAR(one.bounds.hi.x, std::sqrt(0.5), 1e-6);
  const Shape none = make_blobs({{{}, kUnit, 0.2}}, 0.25);
  EXPECT_EQ(none.bounds.lo.x, -std::nextafter(1.0f, 2.0f));
  EXPECT_TRUE(hits_of(none, {0, 0, -3}, {0, 0, 1}).empty());
}

TEST(Blobs, CanBeCsgOperands) {
  Scene scene;
  place_shape(scene, pair_apart(1.2));
  place_shape(scene, make_box({0.25, 4, 4}), moved({0.125, 0, 0}));
  combine(scene, CsgOperation::intersect);
  Ray ray;
  ray.origin = {-3, 0, 0};
  ray.direction = {1, 0, 0};
  const std::vector<Hit> through = all_hits(scene, ray);  // the box is all inside
  ASSERT_EQ(through.size(), 2u);
  EXPECT_EQ(through[0].t, 3);
  EXPECT_EQ(through[1].t, 3.25f);
  ray.origin = {0.125f, 0, -3};
  ray.direction = {0, 0, 1};
  const std::vector<Hit> across = all_hits(scene, ray);
  ASSERT_EQ(across.size(), 2u);
  EXPECT_EQ(across[0].id.instance, 0u);
  const std::vector<Blob> blobs = {{{-0.6, 0, 0}, kUnit, 1}, {{0.6, 0, 0}, kUnit, 1}};
  for (const Hit& hit : across) {
    EXPECT_NEAR(field(blobs, {0.125, 0, static_cast<double>(hit.t) - 3}), 0.25, 1e-6);
  }
}

}  // namespace
}  // namespace tessera::render::testing
