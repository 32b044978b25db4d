#include "worker/guide/guide.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "worker/geometry/frame.h"
#include "worker/guide/light_image.h"
#include "worker/guide/octahedral.h"
#include "worker/guide/photon_source.h"
#include "worker/guide/photon_store.h"
#include "worker/guide/recentred.h"
#include "worker/guide/visible_region.h"
#include "worker/render/parallel_threads.h"
#include "worker/sampling/warp.h"

namespace tessera::render {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kSide = 512;

/// Mean of f over midpoints of a grid of the unit square.
template <typename F>
double grid_mean(int side, F f) {
  double sum = 0;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const auto n = static_cast<float>(side);
      sum += f(Vec2f{(static_cast<float>(x) + 0.5f) / n, (static_cast<float>(y) + 0.5f) / n});
    }
  }
  return sum / (side * side);
}

/// Integral of f over the sphere.
template <typename F>
double sphere_integral(int side, F f) {
  return grid_mean(side, [&](Vec2f p) {
    const Vec3f d = octahedral::direction_of_square(p);
    return static_cast<double>(f(d)) / static_cast<double>(octahedral::density(d));
  });
}

TEST(Octahedral, DensityAndMomentsAreThoseOfSphere) {
  // The integrand is piecewise smooth, so the midpoint rule has an error of O(1 / side^2).
  EXPECT_NEAR(sphere_integral(kSide, [](const Vec3f&) { return 1.0f; }), 4 * kPi, 1e-4);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(sphere_integral(kSide, [axis](const Vec3f& d) { return d[axis]; }), 0, 1e-4);
    EXPECT_NEAR(sphere_integral(kSide, [axis](const Vec3f& d) { return d[axis] * d[axis]; }),
                4 * kPi / 3, 1e-4);
  }
}

TEST(Octahedral, DirectionsReturnToTheirPoint) {
  grid_mean(kSide, [](Vec2f p) {
    const Vec2f back = octahedral::square_of(octahedral::direction_of_square(p));
    EXPECT_NEAR(back.x, p.x, 1e-6f);
    EXPECT_NEAR(back.y, p.y, 1e-6f);
    return 0.0;
  });
}

TEST(Recentred, InverseAndDensityAgree) {
  const Vec3f offset{0.3f, -0.5f, 0.2f};
  for (const float radius : {0.0f, 0.8f, 3.0f}) {
    // A density of 1 / (4 pi) at the centre integrates to 1 at the offset.
    EXPECT_NEAR(
        sphere_integral(kSide, [&](const Vec3f& d) { return recentred(offset, d, radius).scale; }),
        4 * kPi, 1e-3)
        << radius;
    grid_mean(64, [&](Vec2f p) {
      const Vec3f d = octahedral::direction_of_square(p);
      const Vec3f back = direction_from(offset, recentred(offset, d, radius).direction, radius);
      EXPECT_LT(length(back - d), 3e-6f);
      return 0.0;
    });
  }
}

/// Points of a wide lobe and of a narrow one, with unequal weights.
std::vector<DirectionPoint> lobes(int count) {
  PhotonRandom random(7);
  std::vector<DirectionPoint> points;
  for (int i = 0; i < count; ++i) {
    const bool narrow = i % 3 == 0;
    const float size = narrow ? 0.01f : 0.6f;
    const Vec2f u = random.next_2d();
    const Vec2f p{0.37f + size * (u.x - 0.5f), 0.62f + size * (u.y - 0.5f)};
    points.push_back({direction_code(p), narrow ? 2.0f : 1.0f});
  }
  return points;
}

TEST(DirectionTree, DensityIntegratesToOne) {
  auto points = lobes(2000);
  const auto tree = build_direction_tree(points);
  EXPECT_GT(tree.size(), 20u);
  // No leaf is smaller than 2^-11, so the midpoints give the exact sum of the leaves.
  EXPECT_NEAR(
      grid_mean(2048, [&](Vec2f p) { return double{direction_tree_density(tree.data(), p)}; }), 1,
      1e-5);
}

TEST(DirectionTree, IsTheSameForAnyOrderOfPoints) {
  auto points = lobes(2000);
  auto reversed = points;
  std::reverse(reversed.begin(), reversed.end());
  const auto a = build_direction_tree(points), b = build_direction_tree(reversed);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].share, b[i].share);
    EXPECT_EQ(a[i].child, b[i].child);
  }
}

TEST(DirectionTree, NarrowLobeIsDenserByItsWeight) {
  auto points = lobes(30000);
  const auto tree = build_direction_tree(points);
  // Half of the weight is in a square of side 0.01; leaves end at most one size below it.
  const float inside = direction_tree_density(tree.data(), {0.37f, 0.62f});
  EXPECT_GT(inside, 0.5f / (0.01f * 0.01f) / 2);
  EXPECT_LT(inside, 0.5f / (0.01f * 0.01f) * 2);
  // Half of it is spread over a square of side 0.6.
  EXPECT_NEAR(direction_tree_density(tree.data(), {0.55f, 0.5f}), 0.5f / 0.36f, 0.5f);
}

/// Counts samples of a lobe in bins of the square and returns how far chi-square is above its mean,
/// in standard deviations.
double excess_chi_square(const GuideLobe& lobe, int samples) {
  constexpr int kBins = 32;
  std::vector<double> counts(kBins * kBins), expected(kBins * kBins);
  PhotonRandom random(11);
  for (int i = 0; i < samples; ++i) {
    const Vec2f p = octahedral::square_of(lobe.sample(random.next(), random.next_2d()));
    ++counts[static_cast<std::size_t>(p.y * kBins) * kBins + static_cast<std::size_t>(p.x * kBins)];
  }
  const int fine = 64;
  grid_mean(kBins * fine, [&](Vec2f p) {
    const Vec3f d = octahedral::direction_of_square(p);
    const double share =
        static_cast<double>(lobe.pdf(d)) / static_cast<double>(octahedral::density(d));
    expected[static_cast<std::size_t>(p.y * kBins) * kBins +
             static_cast<std::size_t>(p.x * kBins)] +=
        share * samples / (kBins * kBins * fine * fine);
    return 0.0;
  });
  double chi = 0;
  int cells = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (expected[i] < 5) continue;  // the usual limit
    const double difference = counts[i] - expected[i];
    chi += difference * difference / expected[i];
    ++cells;
  }
  EXPECT_GT(cells, 20);
  return (chi - cells) / std::sqrt(2.0 * cells);
}

TEST(GuideLobe, PdfMatchesSamplesAndIntegratesToOne) {
  auto points = lobes(2000);
  const auto tree = build_direction_tree(points);
  for (const float radius : {0.0f, 0.9f, 4.0f}) {
    const GuideLobe lobe{0.5f, 1, radius, {0.3f, -0.4f, 0.1f}, tree.data(), {}, {}};
    // With a radius the leaves' borders are not those of the grid. The narrow lobe, half of the
    // density, covers at least 400 of its cells; some 80 at its border are right by 0.3 cells each,
    // so the sum by 2.6 cells (one standard deviation), or 3e-3 of the whole.
    const double tolerance = radius > 0 ? 1.5e-2 : 1e-4;
    EXPECT_NEAR(sphere_integral(2048, [&](const Vec3f& d) { return lobe.pdf(d); }), 1, tolerance)
        << radius;
    EXPECT_LT(excess_chi_square(lobe, 200'000), 5) << radius;  // 3e-7 by chance
  }
}

TEST(GuideLobe, ImagesAndTreeTogetherAreOneDistribution) {
  auto points = lobes(2000);
  const auto tree = build_direction_tree(points);
  const Vec3f place{0.5f, 0, -0.2f};
  // The light of the first comes from a place, that of the second is parallel, and the third is
  // seen from within.
  const std::array<LightImage, 3> images = {
      {{{0.7f, 1.5f, 0.3f}, {Vec3f{-1, 0, 0}, Vec3f{0, -1, 0}, Vec3f{0, 0.2f, -1}}, 0.3f, 0.3f},
       {{-0.5f, 0.8f, 0.3f}, {}, 0.5f, 0.2f},
       {place, {Vec3f{-1, 0, 0}, Vec3f{0, -1, 0}, Vec3f{0, 0, -1}}, 0.5f, 0.1f}}};
  const GuideLobe lobe{0.5f, 0.4f, 0, {0.3f, -0.4f, 0.1f}, tree.data(), place, images};
  EXPECT_NEAR(sphere_integral(2048, [&](const Vec3f& d) { return lobe.pdf(d); }), 1, 1e-3);
  EXPECT_LT(excess_chi_square(lobe, 200'000), 5);  // 3e-7 by chance
  const GuideLobe without_tree{0.5f, 0, 0, {}, nullptr, place, std::span(images).first(1)};
  EXPECT_EQ(without_tree.sample(0.99f, {0.2f, 0.3f}), images[0].sample(place, {0.2f, 0.3f}));
}

TEST(LightImage, DensityOfNarrowImageIsExact) {
  // Half of the light is within twice its spread, and no rounding of directions matters.
  const LightImage image{{0, 1, 0}, {}, 5e-4f, 1};
  PhotonRandom random(9);
  int inside = 0;
  constexpr int kSamples = 20'000;
  for (int i = 0; i < kSamples; ++i) {
    const Vec3f d = image.sample({0, 0, 0}, random.next_2d());
    const double across = std::hypot(static_cast<double>(d.x), static_cast<double>(d.z));
    inside += across < 1e-3 ? 1 : 0;
    const double t = std::pow(std::tan(std::asin(std::min(across, 1.0)) / 2), 2);
    if (d.y <= 0) continue;
    const double narrow = 0.25e-6;
    const double exact = narrow / (4 * kPi) * std::pow((1 + t) / (narrow + t), 2);
    EXPECT_NEAR(static_cast<double>(image.pdf({0, 0, 0}, d)) / exact, 1, 2e-3);
  }
  EXPECT_NEAR(inside, kSamples / 2, 5 * std::sqrt(kSamples / 4));
}

/// Photons on a floor of 2 x 2 m, from directions that `from` returns for a position.
template <typename F>
std::vector<Photon> floor_photons(int count, F from) {
  PhotonRandom random(3);
  std::vector<Photon> photons;
  for (int i = 0; i < count; ++i) {
    const Vec2f at = random.next_2d();
    const Vec3f position{2 * at.x - 1, 0, 2 * at.y - 1};
    const Vec3f direction = from(position, random.next_2d());
    photons.push_back({position, direction, {0, 1, 0}, 1});
    photons.back().path = static_cast<std::uint64_t>(i);
  }
  return photons;
}

Vec3f from_lamp(const Vec3f& position, Vec2f u) {
  return normalize(Vec3f{0.2f + 0.02f * u.x, 1.5f, 0.1f + 0.02f * u.y} - position);
}

TEST(Guide, PhotonsFromAllSidesNeedNone) {
  const Frame up = Frame::from_normal({0, 1, 0});
  const auto photons = floor_photons(20'000, [&](const Vec3f& /*position*/, Vec2f u) {
    return up.to_world(warp::cosine_hemisphere(u));
  });
  EXPECT_EQ(Guide::from_photons(photons, sequential()), nullptr);
  EXPECT_EQ(Guide::from_photons({}, sequential()), nullptr);
}

TEST(Guide, PhotonsFromLampLeadToIt) {
  const auto guide = Guide::from_photons(floor_photons(20'000, from_lamp), sequential());
  ASSERT_NE(guide, nullptr);
  for (const Vec3f& at : {Vec3f{0.1f, 0, 0.1f}, Vec3f{-0.7f, 0, 0.6f}, Vec3f{0.9f, 0, -0.8f}}) {
    const GuideLobe lobe = guide->at(at, {0, 1, 0});
    ASSERT_GT(lobe.probability, 0.6f);
    // The lamp of 0.02 x 0.02 m subtends less than 2e-4 sr. Without the radius, the directions of a
    // cell of about 0.3 x 0.3 m fill about 4e-2 sr.
    EXPECT_GT(lobe.pdf(from_lamp(at, {0.5f, 0.5f})), 300);
    EXPECT_LT(lobe.pdf(normalize(Vec3f{1, 1, 0})), 1);
  }
  EXPECT_EQ(guide->at({0, 0, 0}, {0, -1, 0}).probability, 0) << "no photon arrived below";
  EXPECT_EQ(guide->at({3, 0, 0}, {0, 1, 0}).probability, 0) << "nor beside the floor";
}

// Both walls lie in planes of cells' borders. Photons in such a plane belong to the same cells as
// the places that are asked for there.
TEST(Guide, WallsAreGuidedEverywhere) {
  std::vector<Photon> photons = floor_photons(40'000, from_lamp);
  for (std::size_t i = 0; i < photons.size(); ++i) {
    Photon& photon = photons[i];
    photon.position = {photon.position.x, photon.position.z, i % 4 == 0 ? -3.0f : 0.0f};
    photon.direction = {photon.direction.x, photon.direction.z, photon.direction.y};
    photon.normal = {0, 0, 1};
    photon.path = i / 4;
  }
  const auto guide = Guide::from_photons(photons, sequential());
  ASSERT_NE(guide, nullptr);
  PhotonRandom random(5);
  for (int i = 0; i < 1000; ++i) {
    const Vec2f at = random.next_2d();
    const Vec3f place{1.9f * at.x - 0.95f, 1.9f * at.y - 0.95f, i % 4 == 0 ? -3.0f : 0.0f};
    EXPECT_GT(guide->at(place, {0, 0, 1}).probability, 0.6f)
        << place.x << ", " << place.y << ", " << place.z;
  }
}

TEST(Guide, PhotonsOfOneHalfAreNotTrusted) {
  auto photons = floor_photons(20'000, from_lamp);
  for (Photon& photon : photons) photon.path *= 2;
  EXPECT_EQ(Guide::from_photons(photons, sequential()), nullptr);
}

TEST(Guide, ManyPhotonsInOnePlaceMakeOneCell) {
  const std::vector<Photon> some = floor_photons(5000, from_lamp);
  std::vector<Photon> photons;
  for (const Photon& photon : some) {
    photons.push_back(photon);
    photons.back().position = {0.5f, 0, 0.5f};
    photons.back().direction = from_lamp(photons.back().position, {0.5f, 0.5f});
  }
  const auto guide = Guide::from_photons(photons, sequential());
  ASSERT_NE(guide, nullptr);
  EXPECT_GT(guide->at({0.5f, 0, 0.5f}, {0, 1, 0}).probability, 0.6f);
}

/// Direction to a lamp of 0.02 x 0.02 m in a mirror ball, at places of the floor around the origin.
Vec3f from_mirror(const Vec3f& position, Vec2f u) {
  const Vec3f lamp{1.5f + 0.02f * u.x, 2, 0.3f + 0.02f * u.y}, centre{0.5f, 1.6f, -2.5f};
  constexpr float kRadius = 0.5f;
  // The normal is in the middle between the directions to both.
  Vec3f normal = normalize(position - centre);
  for (int i = 0; i < 200; ++i) {
    const Vec3f at = centre + normal * kRadius;
    normal = normalize(normalize(lamp - at) + normalize(position - at));
  }
  return normalize(centre + normal * kRadius - position);
}

TEST(LightImage, ImageInMirrorBallIsFound) {
  const auto fit = fit_light_image(floor_photons(64, from_mirror));
  ASSERT_TRUE(fit.has_value());
  // The image moves by some centimetres over the floor. One that does not move has a gain below
  // 100,000.
  EXPECT_GT(fit->gain, 500'000);
  EXPECT_FALSE(fit_light_image(floor_photons(7, from_mirror)).has_value());
}

TEST(LightImage, ImageOfLampNearTheFloorIsNarrowFarFromIt) {
  const auto near = [](const Vec3f& position, Vec2f u) {
    return normalize(Vec3f{0.2f + 0.02f * u.x, 0.2f, 0.1f + 0.02f * u.y} - position);
  };
  const auto fit = fit_light_image(floor_photons(64, near));
  ASSERT_TRUE(fit.has_value());
  const auto density_at = [&](float x) {
    const Vec3f at{x, 0, 0.1f};
    return fit->image.pdf(at, near(at, {0.5f, 0.5f}));
  };
  // At 0.2 m and at 1.2 m; the density in the middle grows with the square of the distance.
  EXPECT_NEAR(density_at(-0.98f) / density_at(0.2f), 36, 7);
}

TEST(LightImage, ParallelAndConvergingLightIsFound) {
  const auto parallel = fit_light_image(floor_photons(64, [](const Vec3f& /*position*/, Vec2f u) {
    return normalize(Vec3f{0.3f + 1e-3f * u.x, 1, 1e-3f * u.y});
  }));
  ASSERT_TRUE(parallel.has_value());
  EXPECT_GT(parallel->gain, 100'000);
  const auto converging = fit_light_image(floor_photons(64, [](const Vec3f& position, Vec2f u) {
    return normalize(position - Vec3f{0.2f + 0.01f * u.x, -2, 0.01f * u.y});
  }));
  ASSERT_TRUE(converging.has_value());
  EXPECT_GT(converging->gain, 10'000);
}

TEST(LightImage, PhotonsThatMissItHardlyMoveIt) {
  auto photons = floor_photons(64, from_lamp);
  for (std::size_t i = 0; i < photons.size(); i += 4) photons[i].direction = {0, 1, 0};
  const auto fit = fit_light_image(photons);
  ASSERT_TRUE(fit.has_value());
  for (const Vec3f& at : {Vec3f{0.1f, 0, 0.1f}, Vec3f{-0.7f, 0, 0.6f}, Vec3f{0.9f, 0, -0.8f}})
    EXPECT_GT(fit->image.pdf(at, from_lamp(at, {0.5f, 0.5f})), 1000);
}

// About 10 of the 1,000 photons of each cell were reflected by the mirror, too few to fit an image;
// it is fitted to those of several cells.
TEST(Guide, FewPhotonsOfWayInCellsShowItsImage) {
  const Frame up = Frame::from_normal({0, 1, 0});
  auto photons = floor_photons(40'000, [&](const Vec3f& /*position*/, Vec2f u) {
    return up.to_world(warp::cosine_hemisphere(u));
  });
  for (std::size_t i = 0; i < photons.size(); i += 100) {
    Photon& photon = photons[i];
    photon.direction = from_mirror(photon.position, {0.5f, 0.5f});
    photon.path = i / 100;
    photon.way = 5;
  }
  const auto guide = Guide::from_photons(photons, sequential());
  ASSERT_NE(guide, nullptr);
  PhotonRandom random(5);
  for (int i = 0; i < 1000; ++i) {
    const Vec2f at = random.next_2d();
    const Vec3f place{1.9f * at.x - 0.95f, 0, 1.9f * at.y - 0.95f};
    const GuideLobe lobe = guide->at(place, {0, 1, 0});
    ASSERT_EQ(lobe.images.size(), 1u);
    EXPECT_GT(lobe.probability, 0.005f);
    EXPECT_GT(lobe.pdf(from_mirror(place, {0.5f, 0.5f})), 1000);
    EXPECT_GT(guide->saving(place, {0, 1, 0}), 0);
  }
}

TEST(PhotonRandom, NumbersNearOthersDifferByStepAndWrap) {
  PhotonRandom first(1);
  std::vector<std::uint64_t> base;
  first.record(&base);
  for (int i = 0; i < 1000; ++i) first.next_double();
  for (const int closeness : {1, 4}) {
    PhotonRandom near(2, base, closeness);
    const double most = std::ldexp(1.0, -closeness - 1);
    double largest = 0;
    for (const std::uint64_t number : base) {
      const double apart = std::fabs(near.next_double() - static_cast<double>(number) * 0x1p-64);
      largest = std::max(largest, std::min(apart, 1 - apart));
    }
    // Largest of 1000 uniform numbers.
    EXPECT_LE(largest, most) << closeness;
    EXPECT_GT(largest, 0.98 * most) << closeness;
    PhotonRandom alone(2);
    for (int i = 0; i < 1000; ++i) alone.next_double();
    EXPECT_EQ(near.next_double(), alone.next_double()) << "new beyond the base";
  }
}

TEST(Guide, SmallShareOfLightIsNotGuided) {
  auto photons = floor_photons(20'000, from_lamp);
  for (Photon& photon : photons) photon.share = 1e-4f;
  EXPECT_EQ(Guide::from_photons(photons, sequential()), nullptr);
}

TEST(Guide, LobesAreOnlyWherePhotonsHaveADirection) {
  const Frame up = Frame::from_normal({0, 1, 0});
  const auto photons = floor_photons(40'000, [&](const Vec3f& position, Vec2f u) {
    return position.x < 0 ? from_lamp(position, u) : up.to_world(warp::cosine_hemisphere(u));
  });
  const auto guide = Guide::from_photons(photons, sequential());
  ASSERT_NE(guide, nullptr);
  // Cells of 512 to 1024 photons are at most 0.32 m wide; one of them may cross the border.
  PhotonRandom random(5);
  for (int i = 0; i < 1000; ++i) {
    const Vec2f at = random.next_2d();
    const Vec3f lit{-0.95f + 0.6f * at.x, 0, 1.9f * at.y - 0.95f};
    EXPECT_GT(guide->at(lit, {0, 1, 0}).probability, 0.6f) << lit.x << ", " << lit.z;
    EXPECT_GT(guide->saving(lit, {0, 1, 0}), 0) << lit.x << ", " << lit.z;
    const Vec3f diffuse{-lit.x, 0, lit.z};
    EXPECT_EQ(guide->at(diffuse, {0, 1, 0}).probability, 0) << diffuse.x << ", " << diffuse.z;
    EXPECT_EQ(guide->saving(diffuse, {0, 1, 0}), 0) << diffuse.x << ", " << diffuse.z;
  }
}

TEST(Guide, IsTheSameForAnyNumberOfThreads) {
  const auto photons = floor_photons(20'000, from_lamp);
  const auto one = Guide::from_photons(photons, sequential());
  const auto four = Guide::from_photons(photons, parallel_threads(4));
  ASSERT_TRUE(one != nullptr && four != nullptr);
  EXPECT_EQ(one->fingerprint(), four->fingerprint());
}

/// `count` photons of different paths that arrive at one place.
std::vector<Photon> photons_at(const Vec3f& position, int count) {
  std::vector<Photon> photons;
  for (int i = 0; i < count; ++i) {
    photons.push_back({position, {0, 1, 0}, {0, 1, 0}, 1});
    photons.back().path = static_cast<std::uint64_t>(i);
  }
  return photons;
}

TEST(PhotonStore, FullCellsWantNoMore) {
  const std::vector<SurfacePlace> places = {{{-1, 0, -1}, {0, 1, 0}}, {{2, 0, 2}, {0, 1, 0}}};
  const VisibleRegion region(places);
  PhotonStore store(region, 0);
  store.add(photons_at(places[0].position, 2000));
  store.add(photons_at(places[1].position, 10));
  const std::size_t in_first = store.photons().size() - 10;
  EXPECT_LT(in_first, 2000u);
  EXPECT_GT(in_first, 100u);
  EXPECT_FALSE(store.wants(photons_at(places[0].position, 1)[0]));
  EXPECT_TRUE(store.wants(photons_at(places[1].position, 1)[0]));
  EXPECT_EQ(store.wanted_paths().size(), 10u);
  EXPECT_EQ(store.share_of_seen(10), 1);
  EXPECT_EQ(store.share_of_seen(11), 0.5);
}

TEST(PhotonStore, FewPixelsNeedFewPhotons) {
  std::vector<SurfacePlace> places;
  for (int i = 0; i < 225; ++i) {
    places.push_back({{static_cast<float>(i % 15), 0, static_cast<float>(i / 15)}, {0, 1, 0}});
  }
  const VisibleRegion region(places);
  PhotonStore small(region, 64), large(region, 100'000);
  for (const SurfacePlace& place : places) {  // 90,000 photons
    small.add(photons_at(place.position, 400));
    large.add(photons_at(place.position, 400));
  }
  EXPECT_TRUE(small.is_enough());
  EXPECT_FALSE(large.is_enough());
}

TEST(PhotonStore, SharesAreOfFluxOfIndependentPaths) {
  const std::vector<SurfacePlace> places = {{{-1, 0, -1}, {0, 1, 0}}, {{2, 0, 2}, {0, 1, 0}}};
  const VisibleRegion region(places);
  PhotonStore store(region, 0);
  auto photons = photons_at(places[0].position, 40);
  for (std::size_t i = 0; i < 30; ++i) photons[i].share = 0;  // light sampling finds these
  store.add(photons);
  store.add_of_chains(photons_at(places[0].position, 100));
  ASSERT_EQ(store.photons().size(), 110u);
  for (const Photon& photon : store.photons()) EXPECT_EQ(photon.share, 0.25f);
}

TEST(VisibleRegion, ContainsPlacesAndWhatIsNearAndFacesAlike) {
  const std::vector<SurfacePlace> places = {{{-1, 0, -1}, {0, 1, 0}}, {{2, 0, 2}, {0, 1, 0}}};
  const VisibleRegion region(places);
  // Cells are a thirtieth of 3 m wide, so 0.1 m; a neighbour is at most 0.2 m away.
  for (const SurfacePlace& place : places) {
    EXPECT_TRUE(region.contains(place));
    EXPECT_TRUE(region.contains({place.position + Vec3f{0.09f, 0, -0.09f}, {0, 0.9f, 0.1f}}));
    EXPECT_FALSE(region.contains({place.position + Vec3f{0.25f, 0, 0}, {0, 1, 0}}));
    EXPECT_FALSE(region.contains({place.position, {0, -1, 0}})) << "the other side";
  }
  EXPECT_FALSE(region.contains({{2.5f, 0, 2}, {0, 1, 0}})) << "outside the grid";
  EXPECT_EQ(region.seen_cells().size(), 2u);
  EXPECT_TRUE(VisibleRegion().contains({{5, 5, 5}, {1, 0, 0}})) << "all of space";
}

// The rounded margin of the grid is a little less than a cell, so the first place is in cell 0 of
// each axis.
TEST(VisibleRegion, PlacesInTheMarginHaveNoNeighboursBeyondIt) {
  for (const Vec3f& normal : {Vec3f{1, 0, 0}, Vec3f{0, 1, 0}}) {
    const VisibleRegion region(
        std::vector<SurfacePlace>{{{-9, -9, -9}, normal}, {{-8.5f, -8.5f, -8.5f}, normal}});
    ASSERT_LT(region.cell({{-9, -9, -9}, {1, 0, 0}}), VisibleRegion::kSide) << "row 0 of layer 0";
    EXPECT_TRUE(region.contains({{-8.99f, -8.99f, -8.99f}, normal}));
    EXPECT_FALSE(region.contains({{-8.49f, -9, -9}, normal})) << "the other end of the row";
  }
}

}  // namespace
}  // namespace tessera::render
