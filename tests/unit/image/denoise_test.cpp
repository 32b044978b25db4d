// Denoising: the vectorised filter against the plain one, the same bits for any bands and threads,
// and what the filter and its error estimate do to images whose truth is known.

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <functional>
#include <random>
#include <string>
#include <utility>

#include "image/denoise/denoiser.h"
#include "image/denoise/filter/half_filter.h"
#include "image/denoise/frame_denoiser.h"
#include "image/denoise/layers.h"
#include "tests/support/scratch_folder.h"
#include "tests/unit/image/half_filter_reference.h"

namespace tessera::image {
namespace {

/// The true value of a channel, and the features of a pixel.
struct Truth {
  std::function<float(int x, int y)> colour, albedo;
};

/// A frame of four noisy replicates, as EXR planes: R, G, B, A, then the denoising channels.
struct NoisyFrame {
  std::int32_t width = 0, height = 0;
  std::vector<ExrPlane> planes;

  NoisyFrame(std::int32_t w, std::int32_t h, const Truth& truth, float noise, std::uint32_t seed)
      : width(w), height(h) {
    for (const char* name : {"R", "G", "B", "A"})
      planes.push_back({name, ExrType::float32, {}, {}});
    for (int r = 0; r < 4; ++r) {
      for (const char* name : kDenoisingChannels) {
        planes.push_back(
            {kDenoisingPrefix + std::to_string(r) + "." + name, ExrType::float32, {}, {}});
      }
    }
    for (ExrPlane& plane : planes) plane.values.resize(static_cast<std::size_t>(w * h));
    std::mt19937 random(seed);
    std::normal_distribution<float> normal(0, noise);
    for (int y = 0; y < h; ++y) {
      for (int x = 0; x < w; ++x) {
        const auto i = static_cast<std::size_t>(y * w + x);
        planes[3].values[i] = 1;
        for (std::size_t r = 0; r < 4; ++r) {
          for (std::size_t c = 0; c < 3; ++c) {
            const float value = truth.colour(x, y) + normal(random);
            planes[4 + 11 * r + c].values[i] = value;
            planes[c].values[i] += value / 4;
            planes[7 + 11 * r + c].values[i] = truth.albedo(x, y);
          }
          planes[12 + 11 * r].values[i] = 1;  // normal.Z
          planes[13 + 11 * r].values[i] = 2;  // depth
          planes[14 + 11 * r].values[i] = 1;  // hits
        }
      }
    }
  }

  /// The rows from `first` on.
  DenoiseRows rows(std::int32_t first) const {
    DenoiseRows rows;
    rows.first = first;
    for (std::size_t k = 0; k < rows.planes.size(); ++k) {
      rows.planes[k] = planes[4 + k].values.data() + first * width;
    }
    return rows;
  }
};

float edge(int x, int y) {
  return x + y / 3 > 40 ? 1.5f : 0.5f;
}
float flat(int, int) {
  return 1;
}

/// Passes a frame through a FrameDenoiser in bands and returns its output.
std::vector<ExrPlane> denoise(const NoisyFrame& frame, std::int32_t band, int threads,
                              DenoisedError* error = nullptr) {
  FrameDenoiser denoiser(frame.width, frame.height, 1, frame.planes, threads);
  std::vector<ExrPlane> output = denoiser.planes();
  for (std::int32_t row = 0; row < frame.height; row += band) {
    const std::int32_t count = std::min(band, frame.height - row);
    std::vector<ExrPlane> rows = frame.planes;
    for (ExrPlane& plane : rows) {
      plane.values.erase(plane.values.begin(), plane.values.begin() + row * frame.width);
    }
    const absl::Status status = denoiser.push(count, rows, [&](std::int32_t n, const auto& planes) {
      for (std::size_t k = 0; k < planes.size(); ++k) {
        output[k].values.insert(output[k].values.end(), planes[k].values.begin(),
                                planes[k].values.begin() + n * frame.width);
      }
      return absl::OkStatus();
    });
    EXPECT_TRUE(status.ok()) << status;
  }
  if (error != nullptr) *error = denoiser.error();
  return output;
}

double mean_square(const std::vector<ExrPlane>& planes, const NoisyFrame& frame, const Truth& truth,
                   const std::string& prefix) {
  double sum = 0;
  for (const ExrPlane& plane : planes) {
    if (plane.name != prefix + "R" && plane.name != prefix + "G" && plane.name != prefix + "B")
      continue;
    for (std::size_t i = 0; i < plane.values.size(); ++i) {
      const int x = static_cast<int>(i) % frame.width, y = static_cast<int>(i) / frame.width;
      const double difference = plane.values[i] - truth.colour(x, y);
      sum += difference * difference / (truth.colour(x, y) * truth.colour(x, y) + 0.01);
    }
  }
  return sum / (3.0 * frame.width * frame.height);
}

Half random_half(std::int32_t width, std::int32_t height) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> uniform(0, 1);
  const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  const auto fill = [&](Plane& plane) {
    plane.resize(pixels);
    for (float& value : plane) value = uniform(random);
  };
  Half half;
  half.width = width;
  half.height = height;
  for (Plane& plane : half.streams.a) fill(plane);
  for (Plane& plane : half.streams.b) fill(plane);
  for (ColourPlanes* colour : {&half.streams.a, &half.streams.b}) {
    for (Plane& plane : *colour) {
      for (std::size_t i = 0; i < pixels; i += 53) plane[i] *= 20;  // small lamps
    }
  }
  std::array<Plane, kHalfFeatures> a, b;
  for (std::size_t k = 0; k < a.size(); ++k) {
    fill(a[k]);
    for (float& value : a[k]) value *= 0.3f;  // similar, so that most weights are above 0
    b[k] = a[k];
    for (float& value : b[k]) value += 0.1f * uniform(random);
  }
  half.valid.assign(pixels, 1);
  for (std::size_t i = 0; i < pixels / 2; i += 11) half.valid[i] = 0;
  for (std::size_t i = 0; i < pixels; i += 7) a[6][i] = b[6][i] = 0;  // misses
  prepare(a, b, half);
  return half;
}

/// The pixels of a plane that are at least kHalfMargin from the border.
Plane inside(const Plane& plane, const Half& half) {
  Plane out;
  for (std::int32_t y = kHalfMargin; y < half.height - kHalfMargin; ++y) {
    const auto row = plane.begin() + std::ptrdiff_t{y} * half.width;
    out.insert(out.end(), row + kHalfMargin, row + half.width - kHalfMargin);
  }
  return out;
}

ColourPlanes inside(const ColourPlanes& planes, const Half& half) {
  return {inside(planes[0], half), inside(planes[1], half), inside(planes[2], half)};
}

/// A half without its border.
Half inside(const Half& half) {
  Half inner;
  inner.width = half.width - 2 * kHalfMargin;
  inner.height = half.height - 2 * kHalfMargin;
  inner.streams = {inside(half.streams.a, half), inside(half.streams.b, half)};
  for (std::size_t k = 0; k < kHalfFeatures; ++k)
    inner.features[k] = inside(half.features[k], half);
  inner.albedo_weight = inside(half.albedo_weight, half);
  inner.normal_weight = inside(half.normal_weight, half);
  inner.depth_weight = inside(half.depth_weight, half);
  inner.valid = inside(half.valid, half);
  return inner;
}

/// Compares the pixels that are at least `inset` from the border of a half.
void expect_equal(const ColourPlanes& x, const ColourPlanes& y, const Half& half,
                  std::int32_t inset) {
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::int32_t row = inset; row < half.height - inset; ++row) {
      for (std::int32_t column = inset; column < half.width - inset; ++column) {
        const auto i = static_cast<std::size_t>(row * half.width + column);
        ASSERT_EQ(std::bit_cast<std::uint32_t>(x[c][i]), std::bit_cast<std::uint32_t>(y[c][i]))
            << "channel " << c << " at " << column << ", " << row;
      }
    }
  }
}

TEST(Denoise, VectorisedFiltersEqualThePlainOnes) {
  const Half half = random_half(72, 60), inner = inside(half);
  const Guide guide = filter_guide(half);
  const Guide inner_guide{inside(guide.colour, half), inside(guide.variance, half)};
  const Candidates fast = filter_candidates(inner, inner_guide);
  const FilteredHalf plain = reference_filter_half(half);
  expect_equal(guide.colour, plain.guide, half, kHalfMargin);
  const auto expect_pairs_equal = [&](const StreamPair& x, const StreamPair& y) {
    expect_equal(x.a, {inside(y.a, half)}, inner, kHalfMargin);
    expect_equal(x.b, {inside(y.b, half)}, inner, kHalfMargin);
  };
  expect_pairs_equal(fast.zero_order, plain.candidates.zero_order);
  expect_pairs_equal(fast.first_order, plain.candidates.first_order);
}

/// A window of a frame, denoised with the rows around it only.
struct DenoisedWindow {
  std::array<std::vector<float>, 3> rgb;
  std::vector<std::uint8_t> is_raw;
  DenoiseSums sums;
};

DenoisedWindow denoise_window(const NoisyFrame& frame, const contract::PixelRect& window,
                              int threads) {
  Denoiser denoiser({frame.width, frame.height, 1}, window, threads);
  DenoisedWindow result;
  for (std::int32_t rows = 0; rows < window.height;) {
    NoisyFrame part = frame;  // the sanitizer finds accesses to other rows
    for (ExrPlane& plane : part.planes)
      plane.values.resize(static_cast<std::size_t>(denoiser.input_end() * frame.width));
    const DenoisedRows band = denoiser.next(part.rows(denoiser.input_begin()));
    for (std::size_t c = 0; c < 3; ++c)
      result.rgb[c].insert(result.rgb[c].end(), band.rgb[c].begin(), band.rgb[c].end());
    result.is_raw.insert(result.is_raw.end(), band.is_raw.begin(), band.is_raw.end());
    rows += band.rows;
  }
  result.sums = denoiser.sums();
  return result;
}

/// Denoises each tile on its own, so that no result of another tile or band is used again.
TEST(Denoise, FrameEqualsItsTilesAlone) {
  for (const auto& [width, height] : {std::pair{270, 150}, {131, 259}, {1, 40}, {133, 1}}) {
    const NoisyFrame frame(width, height, {edge, edge}, 0.2f, 1);
    const DenoisedWindow whole = denoise_window(frame, {0, 0, width, height}, 3);
    DenoiseSums sums;
    for (std::int32_t y = 0; y < height; y += kDenoiseTile) {
      for (std::int32_t x = 0; x < width; x += kDenoiseTile) {
        const contract::PixelRect window{x, y, std::min(kDenoiseTile, width - x),
                                         std::min(kDenoiseTile, height - y)};
        const DenoisedWindow tile = denoise_window(frame, window, 1);
        sums.add(tile.sums);
        for (std::int32_t i = 0; i < window.width * window.height; ++i) {
          const auto from = static_cast<std::size_t>(i);
          const auto to =
              static_cast<std::size_t>((y + i / window.width) * width + x + i % window.width);
          for (std::size_t c = 0; c < 3; ++c)
            ASSERT_EQ(whole.rgb[c][to], tile.rgb[c][from]) << width << "x" << height << ", " << to;
          ASSERT_EQ(whole.is_raw[to], tile.is_raw[from]);
        }
      }
    }
    EXPECT_EQ(whole.sums.pixels, std::int64_t{width} * height);
    EXPECT_EQ(whole.sums.pixel_by_pixel.scaled, sums.pixel_by_pixel.scaled);
    EXPECT_EQ(whole.sums.pixel_by_pixel.spread, sums.pixel_by_pixel.spread);
    EXPECT_EQ(denoised_error(whole.sums).error, denoised_error(sums).error);
    EXPECT_EQ(denoised_error(whole.sums).error_upper95, denoised_error(sums).error_upper95);
    EXPECT_EQ(whole.sums.magnitude, sums.magnitude);
    EXPECT_EQ(whole.sums.magnitude_squares, sums.magnitude_squares);
    EXPECT_EQ(whole.sums.cells, sums.cells);
    EXPECT_EQ(whole.sums.raw_cells, sums.raw_cells);
  }
}

TEST(FrameDenoiser, BandsAndThreadsDoNotChangeBits) {
  const NoisyFrame frame(150, 170, {edge, flat}, 0.2f, 2);
  const std::vector<ExrPlane> one = denoise(frame, 170, 1), many = denoise(frame, 33, 3);
  ASSERT_EQ(one.size(), many.size());
  for (std::size_t k = 0; k < one.size(); ++k) {
    ASSERT_EQ(one[k].values.size(), 150u * 170u) << one[k].name;
    EXPECT_EQ(one[k].values, many[k].values) << one[k].name;
  }
}

/// A frame whose layers all have edges, noise and misses, the same bits with every compiler.
NoisyFrame varied_frame(std::int32_t width, std::int32_t height) {
  NoisyFrame frame(width, height, {flat, flat}, 0, 1);
  std::uint32_t state = 1;
  const auto random = [&state] {
    state = state * 1664525u + 1013904223u;
    return static_cast<float>(state >> 8) * (1.0f / (1 << 24));
  };
  for (std::size_t i = 0; i < frame.planes[0].values.size(); ++i) {
    const int x = static_cast<int>(i) % width, y = static_cast<int>(i) / width;
    const bool is_miss = x / 9 + y / 7 == 6;
    for (std::size_t k = 0; k < kDenoiseInputs; ++k) {
      const std::size_t channel = k % kDenoisingChannels.size();
      const float base = edge(x, y) + ((x / 5 + y / 3) % 2 == 0 ? 0.25f : 0.0f);
      const float noise = channel < 3 ? 0.5f : 0.03125f;
      frame.planes[4 + k].values[i] = is_miss && channel >= 3 ? 0 : base + noise * random();
    }
  }
  return frame;
}

/// FNV-1a of the bits of R, G, B and the error.
std::uint64_t digest_of(const NoisyFrame& frame) {
  DenoisedError error;
  const std::vector<ExrPlane> planes = denoise(frame, frame.height, 1, &error);
  std::uint64_t digest = 14695981039346656037u;
  const auto add = [&digest](std::uint64_t bits) { digest = (digest ^ bits) * 1099511628211u; };
  for (std::size_t c = 0; c < 3; ++c) {
    for (const float value : planes[c].values) add(std::bit_cast<std::uint32_t>(value));
  }
  add(std::bit_cast<std::uint64_t>(error.error));
  add(std::bit_cast<std::uint64_t>(error.error_upper95));
  return digest;
}

/// The digests are part of the render contract.
TEST(FrameDenoiser, BitsStayThoseOfTheContract) {
  EXPECT_EQ(digest_of(varied_frame(150, 133)), 13572889388137096604u);
  EXPECT_EQ(digest_of(varied_frame(1, 1)), 16021304011456458821u);
  EXPECT_EQ(digest_of(varied_frame(1, 70)), 7244734850099259652u);
  EXPECT_EQ(digest_of(varied_frame(259, 3)), 16283221815099291986u);
}

TEST(FrameDenoiser, EmptyPixelsStayEmpty) {
  constexpr std::size_t kWidth = 64;
  NoisyFrame frame(kWidth, 64, {flat, flat}, 0.2f, 5);
  std::mt19937 random(6);
  for (std::size_t i = 0; i < frame.planes[0].values.size(); ++i) {
    // The object fades out to the right.
    const bool is_empty = random() % kWidth < i % kWidth;
    for (std::size_t k = 0; k < frame.planes.size(); ++k) {
      float& value = frame.planes[k].values[i];
      value = is_empty ? 0 : std::max(value, 0.0f);
    }
  }
  const std::vector<ExrPlane> output = denoise(frame, 64, 1);
  for (std::size_t c = 0; c < 3; ++c) {
    ASSERT_EQ(output[c].name, std::string(1, "RGB"[c]));
    for (std::size_t i = 0; i < output[c].values.size(); ++i) {
      ASSERT_GE(output[c].values[i], 0) << "pixel " << i;
      if (output[3].values[i] > 0) continue;
      ASSERT_EQ(output[c].values[i], 0) << "pixel " << i;
    }
  }
}

/// The regression on albedo continues the slope of the bright side into the dark one.
TEST(FrameDenoiser, DenoisedImageIsNowhereNegative) {
  // Stripes of 8 pixels, in which albedo rises from 0 to 1 and light only begins in the middle.
  const Truth truth{[](int x, int) { return static_cast<float>(std::max(x % 8 - 4, 0)); },
                    [](int x, int) { return static_cast<float>(x % 8) / 7; }};
  NoisyFrame frame(64, 64, truth, 0, 9);
  std::mt19937 random(10);
  for (std::size_t i = 0; i < frame.planes[0].values.size(); ++i) {
    for (std::size_t c = 0; c < 3; ++c) {
      float mean = 0;
      for (std::size_t r = 0; r < 4; ++r) {
        float& value = frame.planes[4 + 11 * r + c].values[i];
        value *= random() % 8 == 0 ? 8.0f : 0.0f;  // rare light
        mean += value / 4;
      }
      frame.planes[c].values[i] = mean;
    }
  }
  const std::vector<ExrPlane> output = denoise(frame, 64, 1);
  for (std::size_t c = 0; c < 3; ++c) {
    const std::vector<float>& values = output[c].values;
    EXPECT_GE(*std::min_element(values.begin(), values.end()), 0) << output[c].name;
  }
}

/// Both replicates of a half agree on the outlier, so they do not show that it is noise.
TEST(FrameDenoiser, SingleOutlierIsSpread) {
  constexpr std::size_t kPixel = 32 * 64 + 32;
  NoisyFrame frame(64, 64, {flat, flat}, 0.3f, 8);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t r = 0; r < 2; ++r) frame.planes[4 + 11 * r + c].values[kPixel] = 4;
    frame.planes[c].values[kPixel] = 2.5f;
  }
  const std::vector<ExrPlane> output = denoise(frame, 64, 1);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LT(output[c].values[kPixel], 1.75f) << c;
}

/// If the filters averaged lamps of a pixel with the ground, it would have to be left raw.
TEST(FrameDenoiser, NoiseBesideSmallLampsIsRemoved) {
  const auto is_lamp = [](int x, int y) { return x % 16 == 8 && y % 16 == 8; };
  const Truth truth{[&](int x, int y) { return is_lamp(x, y) ? 40.0f : 1.0f; }, flat};
  const std::vector<ExrPlane> output = denoise(NoisyFrame(64, 64, truth, 0.3f, 11), 64, 1);
  double sum = 0;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) {
      if (is_lamp(x, y)) continue;
      const double error = output[0].values[static_cast<std::size_t>(y * 64 + x)] - 1;
      sum += error * error;
    }
  }
  EXPECT_LT(std::sqrt(sum / (64 * 64 - 16)), 0.05);  // 0.15 in the raw image
}

TEST(FrameDenoiser, NoiseOfFlatAreaFallsTenfold) {
  const Truth truth{edge, flat};
  const NoisyFrame frame(96, 96, truth, 0.2f, 3);
  const auto output = denoise(frame, 96, 1);
  EXPECT_LT(mean_square(output, frame, truth, ""), 0.1 * mean_square(output, frame, truth, "raw."));
}

TEST(FrameDenoiser, MeanOfImageIsKept) {
  const NoisyFrame frame(96, 96, {edge, flat}, 0.2f, 4);
  const auto output = denoise(frame, 96, 1);
  double raw = 0, denoised = 0;
  for (const ExrPlane& plane : output) {
    double& sum = plane.name == "R" ? denoised : raw;
    if (plane.name != "R" && plane.name != "raw.R") continue;
    for (const float value : plane.values) sum += value;
  }
  EXPECT_NEAR(denoised / raw, 1, 0.004);
}

TEST(FrameDenoiser, PatternThatNoFeatureHasIsLeftRaw) {
  const auto random = [](int x, int y) {
    const auto hash = static_cast<std::uint32_t>(x * 7919 + y * 104729) * 2654435761u;
    return 0.2f + static_cast<float>(hash >> 8) * (1.0f / (1 << 24));
  };
  const Truth truth{random, flat};
  for (const float noise : {0.01f, 0.001f}) {
    DenoisedError error;
    const NoisyFrame frame(64, 64, truth, noise, 5);
    const auto output = denoise(frame, 64, 1, &error);
    EXPECT_LE(mean_square(output, frame, truth, ""),
              1.02 * mean_square(output, frame, truth, "raw."));
    if (noise < 0.01f) {
      EXPECT_GT(error.raw_share, 0.1) << "no mixture with a filter is better";
    }
  }
}

TEST(FrameDenoiser, TextureOfAlbedoIsKept) {
  const auto stripes = [](int x, int y) { return (x / 2 + y / 3) % 2 == 0 ? 0.9f : 0.2f; };
  const Truth truth{stripes, stripes};
  const NoisyFrame frame(64, 64, truth, 0.1f, 6);
  const auto output = denoise(frame, 64, 1);
  EXPECT_LT(mean_square(output, frame, truth, ""), 0.3 * mean_square(output, frame, truth, "raw."));
}

TEST(FrameDenoiser, ErrorIsEstimatedWithoutBias) {
  const Truth truth{edge, flat};
  double sum = 0, squares = 0, bounded = 0;
  constexpr int kSeeds = 24;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    const NoisyFrame frame(48, 48, truth, 0.2f, 100 + seed);
    DenoisedError error;
    const double square = mean_square(denoise(frame, 48, 1, &error), frame, truth, "");
    const double difference = error.error * error.error - square;
    sum += difference;
    squares += difference * difference;
    bounded += error.error_upper95 * error.error_upper95 >= square ? 1 : 0;
  }
  EXPECT_LT(std::fabs(sum), 4 * std::sqrt(squares)) << "4 standard errors";
  EXPECT_GE(bounded, kSeeds - 5);
}

/// Mean over the pixels of R of the squared error ÷ (d² + 0.01), as the denoiser measures it: d is
/// limited to the mean of the 5 × 5 pixels around. Pixels at the border are left out.
double measured_square(const ExrPlane& red, std::int32_t width, double truth) {
  const auto at = [&](std::int32_t x, std::int32_t y) {
    return static_cast<double>(red.values[static_cast<std::size_t>(y * width + x)]);
  };
  const std::int32_t height = static_cast<std::int32_t>(red.values.size()) / width;
  double sum = 0;
  for (std::int32_t y = 2; y < height - 2; ++y) {
    for (std::int32_t x = 2; x < width - 2; ++x) {
      double mean = 0;
      for (std::int32_t k = 0; k < 25; ++k) mean += at(x + k % 5 - 2, y + k / 5 - 2) / 25;
      const double d = std::min(at(x, y), mean), error = at(x, y) - truth;
      sum += error * error / (d * d + 0.01);
    }
  }
  return sum / ((width - 4) * (height - 4));
}

/// Half of the light arrives in one of 100 samples, as spikes that the filter removes.
TEST(FrameDenoiser, LightOfRemovedSpikesIsInTheError) {
  constexpr float kChance = 0.01f, kSpike = 100;
  constexpr int kSeeds = 12;
  int held = 0;
  double estimate = 0, truth = 0;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    NoisyFrame frame(64, 64, {flat, flat}, 0.1f, 200 + seed);
    std::mt19937 random(seed);
    std::bernoulli_distribution is_spike(kChance);
    for (std::size_t i = 0; i < frame.planes[0].values.size(); ++i) {
      for (std::size_t r = 0; r < 4; ++r) {
        const float spike = is_spike(random) ? kSpike : 0;
        for (std::size_t c = 0; c < 3; ++c) frame.planes[4 + 11 * r + c].values[i] += spike;
      }
    }
    DenoisedError error;
    const std::vector<ExrPlane> output = denoise(frame, 64, 1, &error);
    const double square = measured_square(output[0], 64, 1 + double{kChance} * double{kSpike});
    held += error.error_upper95 * error.error_upper95 >= square ? 1 : 0;
    estimate += error.error * error.error / kSeeds;
    truth += square / kSeeds;
  }
  EXPECT_GE(held, kSeeds - 2);
  EXPECT_GT(estimate, 0.5 * truth);
  EXPECT_LT(estimate, 1.2 * truth);
}

TEST(FrameDenoiser, FilesWithoutItsChannelsAreRecognised) {
  const NoisyFrame frame(8, 8, {flat, flat}, 0, 1);
  EXPECT_TRUE(FrameDenoiser::has_layers(frame.planes));
  const std::vector<ExrPlane> few(frame.planes.begin(), frame.planes.end() - 1);
  EXPECT_FALSE(FrameDenoiser::has_layers(few));
}

TEST(ExrFile, ReaderReturnsWhatTheWriterWrote) {
  const ScratchFolder folder;
  const std::string path = folder.path() + "/frame.exr";
  std::vector<ExrPlane> planes = {{"A", ExrType::float32, {1, 2, 3, 4, 5, 6}, {}},
                                  {"ids", ExrType::uint32, {}, {9, 8, 7, 6, 5, 4}}};
  const ExrHeader header{{1, 2, 3, 2},
                         {0, 0, 8, 8},
                         {{"tessera:name", "x"}},
                         {{"tessera:frame", 3}},
                         {{"tessera:meanLuminance", 0.1}}};
  auto writer = ExrWriter::open(path, header, planes);
  ASSERT_TRUE(writer.ok() && (*writer)->write_rows(2, planes).ok() && (*writer)->close().ok());
  auto reader = ExrReader::open(path);
  ASSERT_TRUE(reader.ok()) << reader.status();
  EXPECT_EQ((*reader)->header().data_window, header.data_window);
  EXPECT_EQ((*reader)->header().reals, header.reals);
  EXPECT_EQ((*reader)->header().numbers, header.numbers);
  std::vector<ExrPlane> read = (*reader)->planes();
  ASSERT_TRUE((*reader)->read_rows(1, read).ok());
  ASSERT_TRUE((*reader)->read_rows(1, read).ok());
  EXPECT_EQ(read[0].values, (std::vector<float>{4, 5, 6}));
  EXPECT_EQ(read[1].words, (std::vector<std::uint32_t>{6, 5, 4}));
}

TEST(ExrFile, TextIsNoExrFile) {
  const ScratchFolder folder;
  const std::string path = folder.path() + "/text.exr";
  std::FILE* file = std::fopen(path.c_str(), "wb");
  std::fputs("text", file);
  std::fclose(file);
  EXPECT_EQ(ExrReader::open(path).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(ExrReader::open(path + ".no").status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace tessera::image
