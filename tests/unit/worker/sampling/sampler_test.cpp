#include "worker/sampling/sampler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "worker/sampling/dimensions.h"

namespace tessera::render {
namespace {

constexpr int kReplicates = contract::kReplicates;

/// Point k of replicate r of a pixel.
Sampler point(int pixel_x, int replicate, int k, std::uint32_t seed = 7) {
  return {seed, 3, pixel_x, 5, std::int64_t{k} * kReplicates + replicate};
}

/// Returns whether 2^m points fall once into every elementary interval of 2^a by 2^(m-a) cells for
/// all a.
bool is_net(const std::vector<Vec2f>& points, int m) {
  for (int a = 0; a <= m; ++a) {
    std::vector<int> count(points.size(), 0);
    for (const Vec2f& p : points) {
      const auto x = static_cast<std::size_t>(p.x * static_cast<float>(1 << a));
      const auto y = static_cast<std::size_t>(p.y * static_cast<float>(1 << (m - a)));
      ++count[(x << (m - a)) | y];
    }
    if (std::any_of(count.begin(), count.end(), [](int c) { return c != 1; })) return false;
  }
  return true;
}

TEST(Sobol, LaneBitReversalMatchesScalar) {
  std::uint64_t hash = 1;
  for (int i = 0; i < 1000; ++i) {
    hash = mix(hash + 1);
    const auto low = static_cast<std::uint32_t>(hash),
               high = static_cast<std::uint32_t>(hash >> 32);
    const Lanes4 lanes = reverse_bits(Lanes4{low, high, ~low, low ^ high});
    ASSERT_EQ(lanes[0], reverse_bits(low));
    ASSERT_EQ(lanes[1], reverse_bits(high));
    ASSERT_EQ(lanes[2], reverse_bits(~low));
    ASSERT_EQ(lanes[3], reverse_bits(low ^ high));
    ASSERT_EQ(unit_floats(lanes)[2], unit_float(lanes[2]));
  }
}

TEST(Sampler, AlignedBlocksAreNets) {
  for (int pixel = 0; pixel < 6; ++pixel) {
    for (int replicate = 0; replicate < kReplicates; ++replicate) {
      for (const std::uint32_t set : {dimensions::kFilter, dimensions::light(3)}) {
        for (int m = 0; m <= 7; ++m) {
          for (int block = 0; block < 3; ++block) {
            std::vector<Vec2f> points(std::size_t{1} << m);
            for (std::size_t k = 0; k < points.size(); ++k) {
              points[k] = point(pixel, replicate, (block << m) + static_cast<int>(k)).get_2d(set);
            }
            ASSERT_TRUE(is_net(points, m)) << pixel << ' ' << replicate << ' ' << set << ' ' << m;
          }
        }
      }
    }
  }
}

TEST(Sampler, EachDimensionIsStratified) {
  constexpr int kPoints = 256;
  std::array<std::set<int>, 4> cells;
  for (int k = 0; k < kPoints; ++k) {
    const Vec4f p = point(11, 2, k).get_4d(dimensions::bsdf(0));
    for (int d = 0; d < 4; ++d) {
      cells[static_cast<std::size_t>(d)].insert(static_cast<int>(p[d] * kPoints));
    }
  }
  for (const auto& used : cells) EXPECT_EQ(used.size(), kPoints);
}

TEST(Sampler, NumbersAre24BitsAndBelowOne) {
  EXPECT_EQ(unit_float(std::uint32_t{0xffffffff}), 1 - 0x1p-24f);
  EXPECT_LT(unit_double(0xffffffff), 1);
  EXPECT_GT(unit_double(0), 0);
  for (int k = 0; k < 50'000; ++k) {
    const Vec4f p = point(k % 100, k % kReplicates, k).get_4d(static_cast<std::uint32_t>(k % 9));
    for (int d = 0; d < 4; ++d) {
      ASSERT_GE(p[d], 0);
      ASSERT_LT(p[d], 1);
      ASSERT_EQ(p[d] * 0x1p24f, std::floor(p[d] * 0x1p24f));
    }
  }
}

TEST(Sampler, NarrowAccessorsMatchFullSet) {
  const Sampler sampler = point(1, 1, 9);
  const Vec4f all = sampler.get_4d(6);
  const Vec4d fine = sampler.get_4d_fine(6);
  EXPECT_EQ(sampler.get_2d(6), (Vec2f{all.x, all.y}));
  EXPECT_EQ(sampler.get_1d(6), all.x);
  for (int d = 0; d < 4; ++d) EXPECT_EQ(std::floor(fine[d] * 0x1p24), all[d] * 0x1p24f);
}

TEST(Sampler, EveryInputSelectsItsOwnStream) {
  std::vector<Sampler> samplers;
  for (int v = 0; v < 6; ++v) {
    for (std::int64_t i = 0; i < 24; ++i) {
      samplers.emplace_back(v == 0 ? 1u : 0u, v == 1, v == 2, v == 3, v == 4 ? i + 24 : i);
    }
  }
  samplers.resize(std::size_t{5} * 24, samplers[0]);
  samplers.emplace_back(0u, -1, 0, 0, 0);
  samplers.emplace_back(0u, 0, -1, 0, 0);
  std::set<std::array<float, 4>> seen;
  int drawn = 0;
  for (const Sampler& sampler : samplers) {
    for (std::uint32_t set = 0; set < 40; ++set) {
      const Vec4f p = sampler.get_4d(set);
      seen.insert({p.x, p.y, p.z, p.w});
      ++drawn;
    }
  }
  EXPECT_EQ(static_cast<int>(seen.size()), drawn);
}

/// Pearson correlation of two streams of n numbers; about N(0, 1/n) when independent.
template <typename F, typename G>
double correlation(F f, G g, int n) {
  double ff = 0, gg = 0, fg = 0;
  for (int i = 0; i < n; ++i) {
    const double a = f(i) - 0.5, b = g(i) - 0.5;
    ff += a * a;
    gg += b * b;
    fg += a * b;
  }
  return fg / std::sqrt(ff * gg);
}

TEST(Sampler, StreamsAreUncorrelated) {
  constexpr int kPixels = 40'000;
  const auto at = [](std::uint32_t seed, int frame, int dx, int dy, int sample, std::uint32_t set) {
    return
        [=](int i) { return Sampler(seed, frame, i % 200 + dx, i / 200 + dy, sample).get_1d(set); };
  };
  const auto base = at(0, 0, 0, 0, 0, 0);
  const double bound = 4 / std::sqrt(kPixels);  // p = 6e-5 a test
  EXPECT_LT(std::fabs(correlation(base, at(1, 0, 0, 0, 0, 0), kPixels)), bound);
  EXPECT_LT(std::fabs(correlation(base, at(0, 1, 0, 0, 0, 0), kPixels)), bound);
  for (const auto& [dx, dy] : {std::pair{1, 0}, {0, 1}, {1, 1}, {1, -1}, {2, 0}, {0, 2}}) {
    EXPECT_LT(std::fabs(correlation(base, at(0, 0, dx, dy, 0, 0), kPixels)), bound) << dx << dy;
  }
  EXPECT_LT(std::fabs(correlation(base, at(0, 0, 0, 0, 1, 0), kPixels)), bound);
  EXPECT_LT(std::fabs(correlation(base, at(0, 0, 0, 0, 0, 1), kPixels)), bound);
}

double smooth(const Vec2f& p) {
  return std::sin(3 * p.x) * std::exp(p.y);
}

TEST(Sampler, ReplicateMeansAreUnbiasedAndIndependent) {
  // Means of 16 points each: replicates of one pixel must not correlate, or the error estimated
  // from their variance would be wrong.
  constexpr int kPixels = 4000, kPoints = 16;
  const double exact = (1 - std::cos(3.0)) / 3 * (std::exp(1.0) - 1);
  double sum[2] = {0, 0}, square[2] = {0, 0}, product = 0;
  for (int pixel = 0; pixel < kPixels; ++pixel) {
    double mean[2] = {0, 0};
    for (int r = 0; r < 2; ++r) {
      for (int k = 0; k < kPoints; ++k) mean[r] += smooth(point(pixel, r, k).get_2d(2)) / kPoints;
      sum[r] += mean[r] - exact;
      square[r] += (mean[r] - exact) * (mean[r] - exact);
    }
    product += (mean[0] - exact) * (mean[1] - exact);
  }
  for (int r = 0; r < 2; ++r) {
    EXPECT_LT(std::fabs(sum[r]), 4.5 * std::sqrt(square[r])) << "bias of replicate " << r;
  }
  EXPECT_LT(std::fabs(product / std::sqrt(square[0] * square[1])), 4.5 / std::sqrt(kPixels));
}

TEST(Sampler, SmoothIntegrandsBeatMonteCarlo) {
  constexpr int kPixels = 100, kPoints = 256;
  const double exact = (1 - std::cos(3.0)) / 3 * (std::exp(1.0) - 1);
  std::mt19937 random(1);
  std::uniform_real_distribution<float> uniform(0, 1);
  double sobol = 0, monte_carlo = 0;
  for (int pixel = 0; pixel < kPixels; ++pixel) {
    double a = 0, b = 0;
    for (int k = 0; k < kPoints; ++k) {
      a += smooth(point(pixel, 0, k).get_2d(1)) / kPoints;
      const float x = uniform(random);
      b += smooth({x, uniform(random)}) / kPoints;
    }
    sobol += (a - exact) * (a - exact);
    monte_carlo += (b - exact) * (b - exact);
  }
  // About 4,700 times less variance at 256 points.
  EXPECT_LT(sobol * 1000, monte_carlo);
}

TEST(Sampler, DecisionDependsOnlyOnItsArguments) {
  const Sampler sampler = point(4, 1, 2);
  const float base = sampler.chance(2, RayKind::path, 3, 4, 5);
  EXPECT_EQ(base, point(4, 1, 2).chance(2, RayKind::path, 3, 4, 5));
  EXPECT_NE(base, sampler.chance(1, RayKind::path, 3, 4, 5));
  EXPECT_NE(base, sampler.chance(2, RayKind::shadow, 3, 4, 5));
  EXPECT_NE(base, sampler.chance(2, RayKind::path, 4, 3, 5));
  EXPECT_NE(base, sampler.chance(2, RayKind::path, 3, 5, 4));
  EXPECT_NE(base, point(4, 1, 3).chance(2, RayKind::path, 3, 4, 5));
  EXPECT_NE(base, point(4, 2, 2).chance(2, RayKind::path, 3, 4, 5));
  double sum = 0;
  for (std::uint32_t i = 0; i < 10'000; ++i) sum += sampler.chance(0, RayKind::path, 0, 0, i);
  EXPECT_NEAR(sum / 10'000, 0.5, 4.5 * 0.2887 / 100);
}

TEST(Sampler, BitsMatchRenderContract) {
  std::uint64_t digest = 0;
  for (int i = 0; i < 1000; ++i) {
    const Sampler sampler(static_cast<std::uint32_t>(i % 3), i % 5, i % 97, i / 97, i);
    const Vec4f p = sampler.get_4d(static_cast<std::uint32_t>(i % 11));
    for (int d = 0; d < 4; ++d)
      digest = combine(digest, static_cast<std::uint64_t>(p[d] * 0x1p24f));
    digest = combine(
        digest, static_cast<std::uint64_t>(sampler.chance(1, RayKind::shadow, 2, 3, 4) * 0x1p24f));
  }
  EXPECT_EQ(digest, 0xa063a9e789bea0cu);
}

}  // namespace
}  // namespace tessera::render
