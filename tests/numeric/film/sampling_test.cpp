// Hard cases 63, 64, 65: random numbers below 1, uncorrelated dimensions, distinct streams.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "worker/math/elementary.h"
#include "worker/sampling/dimensions.h"
#include "worker/sampling/distribution.h"
#include "worker/sampling/sampler.h"
#include "worker/sampling/warp.h"

namespace tessera::render {
namespace {

constexpr float kLargest = 1 - 0x1p-24f;

TEST(UniformNumbers, StayBelowOne) {
  // Exhaustive for the 2^8 patterns that round up to 1 in u32 * 2^-32, and their neighbours.
  for (std::uint32_t i = 0; i < 1024; ++i) {
    const float u = unit_float(0xffffffffu - i);
    ASSERT_LE(u, kLargest);
    ASSERT_LT(unit_double(0xffffffffu - i), 1.0);
  }
  EXPECT_EQ(unit_float(~std::uint64_t{0}), kLargest);
}

TEST(UniformNumbers, IntervalEndsAreSafeInMappings) {
  const DiscreteDistribution table(std::vector<double>{0, 1, 2, 0});
  for (const float u : {0.0f, 0x1p-24f, kLargest}) {
    EXPECT_TRUE(std::isfinite(elementary::log1p(-u)));
    EXPECT_TRUE(std::isfinite(elementary::log(1 - u)));
    EXPECT_FALSE(std::isnan(std::sqrt(1 - u * u)));
    const int index = table.sample(static_cast<double>(u)).index;
    EXPECT_TRUE(index == 1 || index == 2);
    for (const float v : {0.0f, kLargest}) {
      for (const Vec3f& d : {warp::cosine_hemisphere({u, v}), warp::uniform_hemisphere({u, v}),
                             warp::uniform_sphere({u, v})}) {
        EXPECT_TRUE(is_finite(d));
      }
      EXPECT_GT(warp::cosine_hemisphere_pdf(warp::cosine_hemisphere({u, v}).z), 0);
    }
  }
}

/// Root mean square error of the mean of f over `samples` samples, over many pixels, and the mean
/// error in standard errors.
struct Convergence {
  double rmse, bias_in_errors;
};

template <typename F>
Convergence converge(F f, double exact, int samples) {
  constexpr int kPixels = 300;
  double sum = 0, square = 0;
  for (int pixel = 0; pixel < kPixels; ++pixel) {
    double mean = 0;
    for (int i = 0; i < samples; ++i) mean += f(Sampler(3, 0, pixel, 1, i)) / samples;
    sum += mean - exact;
    square += (mean - exact) * (mean - exact);
  }
  return {std::sqrt(square / kPixels), sum / std::sqrt(square)};
}

/// A product over dimensions of two bounces; biased if they were correlated.
double product(const Sampler& sampler) {
  const Vec4f first = sampler.get_4d(dimensions::bsdf(0));
  const Vec4f second = sampler.get_4d(dimensions::bsdf(1));
  return 16.0 * first.x * first.y * second.x * second.y;
}

TEST(SampleSequence, BouncesAreIndependent) {
  EXPECT_LT(std::fabs(converge(product, 1, 16).bias_in_errors), 4);
  EXPECT_LT(std::fabs(converge(product, 1, 256).bias_in_errors), 4);
  const auto same_component = [](const Sampler& sampler) {
    const double a = sampler.get_1d(dimensions::light(0)) - 0.5;
    const double b = sampler.get_1d(dimensions::light(1)) - 0.5;
    return a * b;
  };
  EXPECT_LT(std::fabs(converge(same_component, 0, 64).bias_in_errors), 4);
  const auto within_set = [](const Sampler& sampler) {
    const Vec4f u = sampler.get_4d(dimensions::light(0));
    return 16.0 * u.x * u.y * u.z * u.w;
  };
  EXPECT_LT(std::fabs(converge(within_set, 1, 64).bias_in_errors), 4);
}

TEST(SampleSequence, SamplesPastPowerOfTwoReduceError) {
  EXPECT_LT(converge(product, 1, 1000).rmse, converge(product, 1, 512).rmse);
}

TEST(SampleSequence, StreamsAreDistinct) {
  // 2^20 pixels x 4 replicates: 64-bit hashes collide by chance with probability 5e-7.
  std::vector<std::uint64_t> streams;
  constexpr int kSide = 1024;
  streams.reserve(std::size_t{kSide} * kSide * contract::kReplicates);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      for (int replicate = 0; replicate < contract::kReplicates; ++replicate) {
        streams.push_back(Sampler(0, 0, x, y, replicate).hash(0));
      }
    }
  }
  std::sort(streams.begin(), streams.end());
  EXPECT_EQ(std::adjacent_find(streams.begin(), streams.end()), streams.end());
}

}  // namespace
}  // namespace tessera::render
