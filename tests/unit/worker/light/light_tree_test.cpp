#include "worker/light/tree/light_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace tessera::render {
namespace {

LightBounds lamp(const Vec3d& position, double strength) {
  LightBounds b;
  b.box_min = b.box_max = position;
  b.normal_angle = std::numbers::pi;
  b.emission_angle = std::numbers::pi / 2;
  b.strength = strength;
  return b;
}

/// A small one-sided patch.
LightBounds patch(const Vec3d& position, const Vec3d& axis, double strength) {
  LightBounds b;
  b.box_min = position - Vec3d{0.01, 0.01, 0.01};
  b.box_max = position + Vec3d{0.01, 0.01, 0.01};
  b.axis = normalize(axis);
  b.emission_angle = std::numbers::pi / 2;
  b.strength = strength;
  return b;
}

/// Lamps, patches and dark lights in a box 20 m wide, determined by the seed.
std::vector<LightBounds> mixed_lights(int count, std::uint32_t seed) {
  std::mt19937 random(seed);
  const auto number = [&random] { return static_cast<double>(random()) / 4294967296.0; };
  std::vector<LightBounds> lights;
  for (int i = 0; i < count; ++i) {
    const double x = number(), y = number(), z = number(), strength = number();
    const Vec3d at = {20 * x - 10, 20 * y - 10, 20 * z - 10};
    const Vec3d axis = {number() - 0.5, number() - 0.5, number() - 0.4};
    lights.push_back(i % 3 == 0 ? lamp(at, strength) : patch(at, axis, strength));
    if (i % 5 == 4) lights.back().both_sides = true;
    if (i % 7 == 6) lights.back().strength = 0;
  }
  return lights;
}

std::vector<LightSampleContext> receivers() {
  return {{{0, 0, 0}, {0, 1, 0}, false},
          {{50, 3, 1}, {-1, 0, 0}, false},
          {{-9, -9, -9}, {0, 0, 1}, true},
          {{1e6f, 0, 0}, {1, 0, 0}, false},
          {{0.3f, 2, -4}, {0, -1, 0}, false}};
}

TEST(LightTree, ProbabilitiesSumToOne) {
  for (const int count : {1, 2, 7, 8, 9, 100, 1000}) {
    const auto lights = mixed_lights(count, 3);
    const LightTree tree(lights);
    for (const LightSampleContext& context : receivers()) {
      double sum = 0;
      for (std::uint32_t i = 0; i < lights.size(); ++i) {
        const double p = tree.probability(context, i);
        EXPECT_EQ(p > 0, lights[i].strength > 0) << i << " of " << count;
        sum += p;
      }
      // Each probability is a product of a few quotients, each precise to 2^-52.
      EXPECT_NEAR(sum, 1, 1e-13) << count;
    }
  }
}

TEST(LightTree, SamplesFollowProbabilities) {
  const auto lights = mixed_lights(300, 11);
  const LightTree tree(lights);
  constexpr int kDraws = 200'000;
  for (const LightSampleContext& context : receivers()) {
    std::vector<int> counts(lights.size());
    for (int i = 0; i < kDraws; ++i) {
      const LightTree::Choice choice = tree.choose(context, (i + 0.5) / kDraws);
      ++counts[choice.light];
      const double p = tree.probability(context, choice.light);
      ASSERT_NEAR(choice.probability, p, 1e-14 + 1e-12 * p);
    }
    // Samples are evenly spread over u, and each light has one interval of u.
    for (std::uint32_t i = 0; i < lights.size(); ++i) {
      EXPECT_NEAR(counts[i], kDraws * tree.probability(context, i), 1.01) << i;
    }
  }
}

/// Second moment divided by the squared mean of an estimate of the irradiance from `lights` (all
/// lamps) that chooses light i with probability p(i).
template <typename Probability>
double relative_second_moment(const std::vector<LightBounds>& lights,
                              const LightSampleContext& context, const Probability& p) {
  double mean = 0, second = 0;
  for (std::uint32_t i = 0; i < lights.size(); ++i) {
    const Vec3d to_light = lights[i].box_min - Vec3d(context.point);
    const double d = length(to_light);
    const double cosine = dot(to_light / d, Vec3d(context.normal));
    if (!(cosine > 0)) continue;
    const double irradiance = lights[i].strength * cosine / (d * d);
    mean += irradiance;
    second += irradiance * irradiance / p(i);
  }
  return second / (mean * mean);
}

TEST(LightTree, ReducesVarianceTenfold) {
  std::vector<LightBounds> lights;
  for (int i = 0; i < 400; ++i) lights.push_back(lamp({i * 0.5, 1, (i % 20) * 0.5}, 1));
  const LightTree tree(lights);
  for (int i = 0; i < 20; ++i) {
    const LightSampleContext context{{5.0f + 9 * static_cast<float>(i), 0, 2}, {0, 1, 0}, false};
    const double by_power =
        relative_second_moment(lights, context, [](std::uint32_t) { return 1 / 400.0; });
    const double by_tree = relative_second_moment(
        lights, context, [&](std::uint32_t light) { return tree.probability(context, light); });
    EXPECT_LT(by_tree - 1, 0.1 * (by_power - 1)) << i;
  }
}

TEST(LightTree, BackfacingPatchesAreNotChosen) {
  const LightSampleContext context{{0, 0, 0}, {0, 1, 0}, false};
  const auto share_of_first = [&context](const LightBounds& first, const LightBounds& second) {
    return LightTree({first, second}).probability(context, 0);
  };
  const LightBounds facing = patch({1, 5, 0}, {0, -1, 0}, 1);
  EXPECT_GT(share_of_first(facing, patch({-1, 5, 0}, {0, 1, 0}, 1)), 0.99);
  EXPECT_GT(share_of_first(facing, patch({-1, -5, 0}, {0, 1, 0}, 1)), 0.99);
  LightBounds both = patch({-1, 5, 0}, {0, 1, 0}, 1);
  both.both_sides = true;
  EXPECT_NEAR(share_of_first(facing, both), 0.5, 1e-6);
}

TEST(LightTree, SpotIsIgnoredOutsideItsCone) {
  LightBounds spot = lamp({0, 4, 0}, 1);
  spot.axis = {0, -1, 0};
  spot.normal_angle = 0.4363148;
  spot.emission_angle = 1.7e-5;
  const LightTree tree({spot, lamp({0, 4, 0}, 1)});
  const auto share_at = [&tree](float x) {
    return tree.probability({{x, 0, 0}, {0, 1, 0}, false}, 0);
  };
  const float edge = 4 * std::tan(0.4363f);
  for (const float x : {0.0f, 1.0f, 0.999f * edge}) EXPECT_NEAR(share_at(x), 0.5, 1e-5) << x;
  for (const float x : {1.01f * edge, 5.0f}) EXPECT_LT(share_at(x), 0.01) << x;
}

TEST(LightTree, DegenerateLayoutsAreHandled) {
  for (const double step : {0.0, 1e-30, 1.0, 1e17}) {
    std::vector<LightBounds> lights;
    for (int i = 0; i < 100; ++i) lights.push_back(lamp({i * step, 0, 0}, 1 + i));
    const LightTree tree(lights);
    for (const LightSampleContext& context : {LightSampleContext{{0, 0, 0}, {0, 1, 0}, false},
                                              LightSampleContext{{0, 1, 0}, {0, -1, 0}, false}}) {
      double sum = 0;
      for (std::uint32_t i = 0; i < 100; ++i) {
        const double p = tree.probability(context, i);
        EXPECT_TRUE(p > 0 && p <= 1) << step << " " << i << " " << p;
        sum += p;
      }
      EXPECT_NEAR(sum, 1, 1e-13) << step;
    }
  }
  EXPECT_TRUE(LightTree().empty());
  EXPECT_TRUE(LightTree({lamp({0, 0, 0}, 0)}).empty());
}

TEST(LightTree, PowerOfTwoScaleKeepsProbabilities) {  // hard case 5
  auto lights = mixed_lights(200, 5);
  const LightTree tree(lights);
  constexpr double kScale = 1024;
  for (LightBounds& b : lights) {
    b.box_min = b.box_min * kScale;
    b.box_max = b.box_max * kScale;
    b.strength *= kScale * kScale;
  }
  const LightTree larger(lights);
  for (LightSampleContext context : receivers()) {
    std::vector<double> before;
    for (std::uint32_t i = 0; i < 200; ++i) before.push_back(tree.probability(context, i));
    context.point = context.point * static_cast<float>(kScale);
    for (std::uint32_t i = 0; i < 200; ++i) {
      EXPECT_EQ(larger.probability(context, i), before[i]) << i;
    }
  }
}

}  // namespace
}  // namespace tessera::render
