// Denoising of animations: what is taken from the neighbours of a frame and what is not, the error
// and its bound, ghosts, and the same bits for any number of threads.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "image/denoise/frame_denoiser.h"
#include "image/denoise/layers.h"

namespace tessera::image {
namespace {

constexpr std::int32_t kSide = 72;
constexpr std::size_t kPixels = std::size_t{kSide} * kSide;
constexpr std::size_t kFirstInput = 3 + 4;  // after R, G, B and the motion

using Value = std::function<float(int x, int y, int frame)>;
using Motion = std::function<std::array<float, 4>(int x, int y, int frame)>;

/// The true values of an animation. The motion is 0 unless it is set.
struct Truth {
  Value colour;
  Value albedo = [](int, int, int) { return 1.0f; };
  Motion motion = [](int, int, int) { return std::array<float, 4>{}; };
};

std::vector<ExrPlane> empty_planes() {
  std::vector<ExrPlane> planes;
  const auto add = [&](const std::string& name) {
    planes.push_back({name, ExrType::float32, std::vector<float>(kPixels), {}});
  };
  for (const char* name : {"R", "G", "B"}) add(name);
  for (const char* name : kMotionChannels) add(name);
  for (int r = 0; r < 4; ++r) {
    for (const char* name : kDenoisingChannels)
      add(kDenoisingPrefix + std::to_string(r) + "." + name);
  }
  return planes;
}

/// A noisy frame of an animation.
struct Frame {
  std::vector<ExrPlane> planes = empty_planes();
  AnimationFrame frame;

  Frame(const Truth& truth, int number, float noise, std::uint32_t seed, int threads = 1) {
    std::mt19937 random(1000 * seed + static_cast<std::uint32_t>(number));
    std::normal_distribution<float> normal(0, 1);
    for (std::size_t i = 0; i < kPixels; ++i) {
      const int x = static_cast<int>(i) % kSide, y = static_cast<int>(i) / kSide;
      const std::array<float, 4> motion = truth.motion(x, y, number);
      for (std::size_t k = 0; k < 4; ++k) planes[3 + k].values[i] = motion[k];
      for (std::size_t r = 0; r < 4; ++r) {
        const std::size_t first = kFirstInput + 11 * r;
        for (std::size_t c = 0; c < 3; ++c) {
          const float value = truth.colour(x, y, number) + noise * normal(random);
          planes[first + c].values[i] = value;
          planes[c].values[i] += value / 4;
          planes[first + 3 + c].values[i] = truth.albedo(x, y, number);
        }
        planes[first + 8].values[i] = 1;   // normal.Z
        planes[first + 9].values[i] = 2;   // depth
        planes[first + 10].values[i] = 1;  // hits
      }
    }
    frame = animation_frame(kSide, kSide, 1, planes, threads);
  }
};

/// Frame 1 with its neighbours 0 and 2.
struct Three {
  Frame before, now, after;

  Three(const Truth& truth, float noise, std::uint32_t seed, int threads = 1)
      : before(truth, 0, noise, seed, threads),
        now(truth, 1, noise, seed, threads),
        after(truth, 2, noise, seed, threads) {}

  FusedFrame fused(int threads = 1) const {
    return fuse_frames(now.frame, &before.frame, &after.frame, threads);
  }
};

struct Denoised {
  std::vector<ExrPlane> planes;
  DenoisedError error;
};

Denoised denoise(const Frame& frame, const AnimationInput* animation, int threads = 1) {
  FrameDenoiser denoiser(kSide, kSide, 1, frame.planes, threads, animation);
  Denoised result{denoiser.planes(), {}};
  const absl::Status status =
      denoiser.push(kSide, frame.planes, [&](std::int32_t rows, const auto& band) {
        for (std::size_t k = 0; k < band.size(); ++k) {
          result.planes[k].values.insert(result.planes[k].values.end(), band[k].values.begin(),
                                         band[k].values.begin() + rows * kSide);
        }
        return absl::OkStatus();
      });
  EXPECT_TRUE(status.ok()) << status;
  result.error = denoiser.error();
  return result;
}

Denoised denoise(const Three& frames, int threads = 1) {
  const FusedFrame fused = frames.fused(threads);
  const AnimationInput input{frames.now.frame, fused};
  return denoise(frames.now, &input, threads);
}

DenoiseSums sums_of(const Three& frames) {
  const FusedFrame fused = frames.fused();
  const AnimationInput input{frames.now.frame, fused};
  Denoiser denoiser(frames.now.frame.frame, {0, 0, kSide, kSide}, 1, &input);
  for (std::int32_t rows = 0; rows < kSide;) {
    DenoiseRows part = frames.now.frame.rows;
    part.first = denoiser.input_begin();
    for (const float*& plane : part.planes) plane += std::ptrdiff_t{part.first} * kSide;
    rows += denoiser.next(part).rows;
  }
  return denoiser.sums();
}

/// Calls visit(value, truth, pixel x, y) for R, G and B of all pixels.
template <typename Visit>
void for_each_value(const std::vector<ExrPlane>& planes, const Truth& truth, const Visit& visit) {
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < kPixels; ++i) {
      const int x = static_cast<int>(i) % kSide, y = static_cast<int>(i) / kSide;
      visit(static_cast<double>(planes[c].values[i]), static_cast<double>(truth.colour(x, y, 1)), x,
            y);
    }
  }
}

/// The square of the contract's error, with m = 1.
double true_square(const std::vector<ExrPlane>& planes, const Truth& truth) {
  double sum = 0;
  for_each_value(planes, truth, [&](double value, double expected, int, int) {
    sum += (value - expected) * (value - expected) / (expected * expected + 0.01);
  });
  return sum / (3 * static_cast<double>(kPixels));
}

/// Mean square of the noise of the first replicate's red.
double fused_noise(const float* plane, const Truth& truth) {
  double sum = 0;
  for (std::size_t i = 0; i < kPixels; ++i) {
    const int x = static_cast<int>(i) % kSide, y = static_cast<int>(i) / kSide;
    const double difference = plane[i] - truth.colour(x, y, 1);
    sum += difference * difference;
  }
  return sum / static_cast<double>(kPixels);
}

float flat(int, int, int) {
  return 1;
}

/// A lamp that passes in front of a wall and lights it.
float lamp(int x, int y, int frame) {
  const auto dx = static_cast<float>(x - 26 - 10 * frame), dy = static_cast<float>(y - 36);
  return 0.3f + 4 / (1 + (dx * dx + dy * dy) * (1.0f / 30));
}

float texture(int x, int y) {
  return 0.5f + 0.25f * static_cast<float>((7 * (x / 3) + 5 * (y / 3)) % 4);
}

/// A texture that moves 3 pixels to the right and 2 up per frame.
Truth moving_texture() {
  const Value value = [](int x, int y, int frame) {
    return texture(x - 3 * frame + 60, y + 2 * frame);
  };
  return {value, value, [](int, int, int) { return std::array<float, 4>{-3, -2, 3, 2}; }};
}

TEST(FrameFusion, StillFramesAreAveraged) {
  const Truth truth{flat};
  const Three frames(truth, 0.2f, 1);
  const double own = fused_noise(frames.now.frame.rows.planes[0], truth);
  const double fused = fused_noise(frames.fused().planes[0].data(), truth);
  EXPECT_NEAR(own, 0.04, 0.003);
  EXPECT_LT(fused, 0.4 * own);  // a third if all weights were 1
}

TEST(FrameFusion, MovingTextureIsFollowed) {
  const Truth truth = moving_texture();
  const Three frames(truth, 0.05f, 2);
  const double own = fused_noise(frames.now.frame.rows.planes[0], truth);
  const double fused = fused_noise(frames.fused().planes[0].data(), truth);
  EXPECT_LT(fused, 0.45 * own);  // the pixels that came into the frame have one neighbour only
}

TEST(FrameFusion, HalfPixelMotionKeepsTheMean) {
  Truth truth{[](int x, int, int frame) {
    return 1 + 0.02f * (static_cast<float>(x) - 0.5f * static_cast<float>(frame));
  }};
  truth.motion = [](int, int, int) { return std::array<float, 4>{-0.5f, 0, 0.5f, 0}; };
  const Three frames(truth, 0, 3);
  const FusedFrame fused = frames.fused();
  for (std::size_t i = 0; i < kPixels; ++i) {
    const int x = static_cast<int>(i) % kSide;
    if (x == 0 || x == kSide - 1) continue;  // one of the neighbours is outside
    // The colour changes by 0.01 in half a pixel.
    ASSERT_NEAR(fused.planes[0][i], frames.now.frame.rows.planes[0][i], 1e-4) << i;
  }
}

/// The wall behind an object has no colour of its own, so only the motion tells them apart.
TEST(FrameFusion, OtherSurfaceIsNotUsed) {
  Truth truth{flat};
  truth.motion = [](int, int, int frame) {
    return frame == 1 ? std::array<float, 4>{} : std::array<float, 4>{6, 0, 6, 0};
  };
  const Three frames(truth, 0.2f, 4);
  const FusedFrame fused = frames.fused();
  for (std::size_t k = 0; k < fused.planes.size(); ++k) {
    const float* own = frames.now.frame.rows.planes[k];
    ASSERT_TRUE(std::equal(fused.planes[k].begin(), fused.planes[k].end(), own)) << k;
  }
}

TEST(FrameFusion, ChangedLightIsNotUsed) {
  const Truth truth{[](int, int, int frame) { return frame == 1 ? 1.0f : 1.4f; }};
  const Three frames(truth, 0.1f, 5);
  const FusedFrame fused = frames.fused();
  const float* own = frames.now.frame.rows.planes[0];
  EXPECT_TRUE(std::equal(fused.planes[0].begin(), fused.planes[0].end(), own));
}

TEST(FrameFusion, OtherAlbedoIsNotUsed) {
  Truth truth{flat};
  truth.albedo = [](int, int, int frame) { return frame == 1 ? 0.8f : 0.2f; };
  const Three frames(truth, 0.1f, 6);
  const FusedFrame fused = frames.fused();
  const float* own = frames.now.frame.rows.planes[0];
  EXPECT_TRUE(std::equal(fused.planes[0].begin(), fused.planes[0].end(), own));
}

TEST(FrameFusion, MotionOutOfTheFrameIsIgnored) {
  Truth truth{flat};
  truth.motion = [](int, int, int) { return std::array<float, 4>{65536, -65536, -1e30f, 1e30f}; };
  const Three frames(truth, 0.1f, 7);
  const FusedFrame fused = frames.fused();
  const float* own = frames.now.frame.rows.planes[0];
  EXPECT_TRUE(std::equal(fused.planes[0].begin(), fused.planes[0].end(), own));
}

TEST(AnimationDenoiser, ThreadsDoNotChangeBits) {
  const Truth truth = moving_texture();
  const Denoised one = denoise(Three(truth, 0.2f, 8, 1), 1),
                 many = denoise(Three(truth, 0.2f, 8, 3), 3);
  for (std::size_t k = 0; k < one.planes.size(); ++k)
    EXPECT_EQ(one.planes[k].values, many.planes[k].values) << one.planes[k].name;
  EXPECT_EQ(one.error.error, many.error.error);
  EXPECT_EQ(one.error.error_upper95, many.error.error_upper95);
}

TEST(AnimationDenoiser, RawImageIsThatOfTheFrame) {
  const Three frames(moving_texture(), 0.2f, 9);
  const Denoised denoised = denoise(frames);
  const auto raw = std::find_if(denoised.planes.begin(), denoised.planes.end(),
                                [](const ExrPlane& plane) { return plane.name == "raw.R"; });
  ASSERT_NE(raw, denoised.planes.end());
  EXPECT_EQ(raw->values, frames.now.planes[0].values);
  EXPECT_NE(denoised.planes[0].values, raw->values);
}

TEST(AnimationDenoiser, UselessNeighboursChangeNoBit) {
  Truth truth{lamp};
  truth.motion = [](int, int, int) { return std::array<float, 4>{-1000, 0, 1000, 0}; };
  const Three frames(truth, 0.2f, 10);
  const Denoised alone = denoise(frames.now, nullptr), animation = denoise(frames);
  for (std::size_t c = 0; c < 3; ++c)
    EXPECT_EQ(alone.planes[c].values, animation.planes[c].values) << c;
}

/// Means over seeds of the squared errors with and without neighbours.
struct Squares {
  double alone = 0, animation = 0;
};

Squares mean_squares(const Truth& truth, float noise, std::uint32_t first_seed, int seeds) {
  Squares squares;
  for (int k = 0; k < seeds; ++k) {
    const Three frames(truth, noise, first_seed + static_cast<std::uint32_t>(k));
    squares.alone += true_square(denoise(frames.now, nullptr).planes, truth) / seeds;
    squares.animation += true_square(denoise(frames).planes, truth) / seeds;
  }
  return squares;
}

TEST(AnimationDenoiser, StillTextureHasLessError) {
  const Value value = [](int x, int y, int) { return texture(x, y); };
  const Squares squares = mean_squares({value}, 0.3f, 20, 4);
  EXPECT_LT(squares.animation, 0.7 * squares.alone);
}

TEST(AnimationDenoiser, MovingTextureHasLessError) {
  const Squares squares = mean_squares(moving_texture(), 0.3f, 30, 4);
  EXPECT_LT(squares.animation, 0.7 * squares.alone);
}

TEST(AnimationDenoiser, MovingLampHasNoMoreError) {
  const Squares squares = mean_squares({lamp}, 0.3f, 40, 4);
  EXPECT_LT(squares.animation, squares.alone);
}

/// The fraction of the change towards the neighbours' mean that is left in the image: 2/3 for the
/// mean of the three frames.
TEST(AnimationDenoiser, MovingLampLeavesNoGhost) {
  const Truth truth{lamp};
  double alone = 0, animation = 0;
  const auto ghost = [&](const std::vector<ExrPlane>& planes) {
    double product = 0, square = 0;
    for_each_value(planes, truth, [&](double value, double expected, int x, int y) {
      const double change =
          0.5 * (static_cast<double>(lamp(x, y, 0)) + static_cast<double>(lamp(x, y, 2))) -
          expected;
      product += change * (value - expected) / (expected * expected + 0.01);
      square += change * change / (expected * expected + 0.01);
    });
    return product / square;
  };
  constexpr int kSeeds = 4;
  for (std::uint32_t seed = 50; seed < 50 + kSeeds; ++seed) {
    const Three frames(truth, 0.3f, seed);
    alone += ghost(denoise(frames.now, nullptr).planes) / kSeeds;
    animation += ghost(denoise(frames).planes) / kSeeds;
  }
  EXPECT_LT(animation, alone + 0.02) << alone;
}

/// The error is estimated without bias, and its bound holds.
TEST(AnimationDenoiser, BoundHolds) {
  int held = 0;
  constexpr int kSeeds = 20;
  double square = 0, estimate = 0, variance = 0;
  for (std::uint32_t seed = 60; seed < 60 + kSeeds; ++seed) {
    const Three frames({lamp}, 0.3f, seed);
    const Denoised denoised = denoise(frames);
    const double error = true_square(denoised.planes, {lamp});
    held += denoised.error.error_upper95 * denoised.error.error_upper95 >= error ? 1 : 0;
    const DenoiseSums sums = sums_of(frames);
    const double terms = 3 * static_cast<double>(kPixels);
    square += error / kSeeds;
    estimate += sums.pixel_by_pixel.scaled / terms / kSeeds;
    variance += sums.pixel_by_pixel.spread / (terms * terms * kSeeds * kSeeds);
  }
  EXPECT_GE(held, 17);  // with a rate of 0.95, fewer in one of 60 runs
  EXPECT_NEAR(estimate, square, 3 * std::sqrt(variance));
}

}  // namespace
}  // namespace tessera::image
