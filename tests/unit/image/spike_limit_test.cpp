// Limiting spikes, the light of rare paths: against a plain reference, and what it leaves alone.

#include "image/denoise/filter/spike_limit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <random>
#include <vector>

#include "image/denoise/filter/half_filter.h"

namespace tessera::image {
namespace {

constexpr std::int32_t kSpikeSide = 20;

StreamPair grey_pair() {
  StreamPair streams;
  for (ColourPlanes* colour : {&streams.a, &streams.b}) {
    for (Plane& plane : *colour) plane.assign(kSpikeSide * kSpikeSide, 1);
  }
  return streams;
}

Plane all_valid() {
  return Plane(kSpikeSide * kSpikeSide, 1);
}

std::size_t spike_at(std::int32_t x, std::int32_t y) {
  return static_cast<std::size_t>(y * kSpikeSide + x);
}

/// R + G + B of a pixel of the frame, otherwise 0.
float sum_at(const ColourPlanes& colour, const Plane& valid, std::int32_t x, std::int32_t y) {
  const std::size_t i = spike_at(x, y);
  return valid[i] == 0 ? 0.0f : (colour[0][i] + colour[1][i]) + colour[2][i];
}

/// limit_spikes() pixel by pixel: the factor of a pixel in one of the streams.
float plain_factor(const StreamPair& streams, bool is_a, const Plane& valid, std::int32_t x,
                   std::int32_t y) {
  std::vector<float> neighbours;
  for (std::int32_t dy = -1; dy <= 1; ++dy) {
    for (std::int32_t dx = -1; dx <= 1; ++dx) {
      if (dx == 0 && dy == 0) continue;
      neighbours.push_back(sum_at(streams.a, valid, x + dx, y + dy));
      neighbours.push_back(sum_at(streams.b, valid, x + dx, y + dy));
    }
  }
  std::sort(neighbours.begin(), neighbours.end(), std::greater<>());
  const float own = sum_at(is_a ? streams.a : streams.b, valid, x, y);
  const float limit = std::max(sum_at(is_a ? streams.b : streams.a, valid, x, y), neighbours[1]);
  return own > 2 * limit ? limit / own : 1.0f;
}

StreamPair plain_limit(const StreamPair& streams, const Plane& valid) {
  StreamPair limited = streams;
  for (std::int32_t y = kSpikeMargin; y < kSpikeSide - kSpikeMargin; ++y) {
    for (std::int32_t x = kSpikeMargin; x < kSpikeSide - kSpikeMargin; ++x) {
      int count = 0;
      for (std::int32_t dy = -3; dy <= 3; ++dy) {
        for (std::int32_t dx = -3; dx <= 3; ++dx) {
          for (const bool is_a : {true, false})
            count += plain_factor(streams, is_a, valid, x + dx, y + dy) < 1 ? 1 : 0;
        }
      }
      if (count == 0 || count > 2) continue;
      for (std::size_t c = 0; c < 3; ++c) {
        limited.a[c][spike_at(x, y)] *= plain_factor(streams, true, valid, x, y);
        limited.b[c][spike_at(x, y)] *= plain_factor(streams, false, valid, x, y);
      }
    }
  }
  return limited;
}

TEST(SpikeLimit, EqualsThePlainReference) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<float> uniform;
  int limited_count = 0;
  for (int round = 0; round < 50; ++round) {
    StreamPair streams = grey_pair();
    for (ColourPlanes* colour : {&streams.a, &streams.b}) {
      for (Plane& plane : *colour) {
        for (float& value : plane) value = uniform(rng) + (uniform(rng) < 0.01f ? 20.0f : 0.0f);
      }
    }
    Plane valid = all_valid();
    for (std::size_t i = 0; i < 12 * kSpikeSide; ++i) valid[i] = round % 2 == 0 ? 1.0f : 0.0f;
    const StreamPair before = streams, expected = plain_limit(streams, valid);
    limit_spikes(valid, kSpikeSide, streams);
    EXPECT_EQ(streams.a, expected.a);
    EXPECT_EQ(streams.b, expected.b);
    limited_count += streams.a == before.a && streams.b == before.b ? 0 : 1;
  }
  EXPECT_GE(limited_count, 40);
}

TEST(SpikeLimit, RarePathOfOneStreamIsScaledDown) {
  StreamPair streams = grey_pair();
  const std::size_t i = spike_at(9, 10);
  for (std::size_t c = 0; c < 3; ++c) streams.a[c][i] = static_cast<float>(10 * (c + 1));
  limit_spikes(all_valid(), kSpikeSide, streams);
  // 60 in sum becomes 3, the sum of the other stream, and keeps its hue.
  EXPECT_FLOAT_EQ(streams.a[0][i], 0.5f);
  EXPECT_FLOAT_EQ(streams.a[2][i], 1.5f);
  streams.a[0][i] = streams.a[1][i] = streams.a[2][i] = 1;
  EXPECT_EQ(streams.a, grey_pair().a);
  EXPECT_EQ(streams.b, grey_pair().b);
}

TEST(SpikeLimit, LightOfBothStreamsIsKept) {
  StreamPair streams = grey_pair();
  streams.a[0][spike_at(9, 10)] = streams.b[0][spike_at(9, 10)] = 50;  // a bright point
  for (std::int32_t y = 0; y < kSpikeSide; ++y) streams.a[1][spike_at(14, y)] = 50;  // a line
  const StreamPair before = streams;
  limit_spikes(all_valid(), kSpikeSide, streams);
  EXPECT_EQ(streams.a, before.a);
  EXPECT_EQ(streams.b, before.b);
}

TEST(SpikeLimit, ManySpikesAreTheLightItself) {
  StreamPair streams = grey_pair();
  for (std::int32_t y = 5; y < 15; y += 3) {
    for (std::int32_t x = 5; x < 15; x += 3) streams.b[0][spike_at(x, y)] = 50;
  }
  const StreamPair before = streams;
  limit_spikes(all_valid(), kSpikeSide, streams);
  EXPECT_EQ(streams.b, before.b);
}

}  // namespace
}  // namespace tessera::image
