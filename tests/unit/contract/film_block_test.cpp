#include "contract/film_block.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

namespace tessera::contract {
namespace {

constexpr std::uint32_t kAllAovs = 0xFF;

FilmBlock random_block(const FilmBlockShape& shape, std::mt19937& rng) {
  FilmBlock block = FilmBlock::zeros(shape);
  const auto fill = [&rng](std::vector<float>& plane) {
    for (float& value : plane) value = std::ldexp(static_cast<float>(rng()), int(rng() % 40) - 40);
  };
  for (auto* plane : {&block.rgb, &block.alpha, &block.albedo, &block.normal, &block.hits,
                      &block.depth, &block.position}) {
    fill(*plane);
  }
  for (std::uint32_t& id : block.ids) id = static_cast<std::uint32_t>(rng());
  for (std::uint32_t pixel = 0; pixel < shape.pixel_count(); pixel += 3) {
    block.dropped.push_back({pixel, pixel % kReplicates, 1 + pixel % 2});
  }
  block.clamped_energy = 1.25;
  block.truncated_energy = 2.5;
  block.transparency_limit_count = 0x123456789ABCDEF0;
  return block;
}

TEST(FilmBlock, EveryShapeRoundTrips) {
  std::mt19937 rng(1);
  for (const bool first : {false, true}) {
    for (std::uint32_t aovs = 0; aovs <= kAllAovs; ++aovs) {
      const FilmBlockShape shape{5, 3, aovs, first};
      const FilmBlock block = random_block(shape, rng);
      const std::string bytes = encode(block);
      const absl::StatusOr<FilmBlock> back = decode(bytes, shape, 8);
      ASSERT_TRUE(back.ok()) << back.status() << " aovs " << aovs;
      ASSERT_EQ(*back, block) << "aovs " << aovs;
      ASSERT_EQ(encode(*back), bytes);
      ASSERT_EQ(static_cast<std::int64_t>(bytes.size()),
                film_block_bytes(shape) + 12 * static_cast<std::int64_t>(block.dropped.size()));
    }
  }
}

TEST(FilmBlock, PlainPixelTakes52Bytes) {
  // 4 replicates of RGB and one alpha.
  EXPECT_EQ(film_block_bytes({64, 64, 0, false}), 52 * 64 * 64 + 28);
  EXPECT_EQ(film_block_bytes({64, 64, kAovDepth, false}), 52 * 64 * 64 + 28) << "pass 0 only";
  EXPECT_EQ(film_block_bytes({64, 64, kAovDepth, true}), 56 * 64 * 64 + 28);
}

TEST(FilmBlock, BytesAreLittleEndianPlanesInOrder) {
  FilmBlock block = FilmBlock::zeros({1, 1, 0, false});
  block.rgb[0] = 1.0f;
  block.alpha[0] = 2.0f;
  const std::string bytes = encode(block);
  EXPECT_EQ(bytes.substr(0, 4), std::string("\x00\x00\x80\x3f", 4));
  EXPECT_EQ(bytes.substr(48, 4), std::string("\x00\x00\x00\x40", 4));
}

TEST(FilmBlock, WrongLengthIsRejected) {
  std::mt19937 rng(2);
  const FilmBlockShape shape{2, 2, kAllAovs, true};
  const std::string bytes = encode(random_block(shape, rng));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    ASSERT_FALSE(decode(std::string_view(bytes).substr(0, size), shape, 8).ok()) << size;
  }
  EXPECT_FALSE(decode(bytes + '\0', shape, 8).ok());
  EXPECT_TRUE(decode(bytes, shape, 8).ok());
}

TEST(FilmBlock, NonFiniteValuesAreRejectedInEveryPlane) {
  const FilmBlockShape shape{1, 1, kAllAovs, true};
  const std::string bytes = encode(FilmBlock::zeros(shape));
  constexpr std::size_t kFloats = 12 + 1 + 3 + 3 + 1 + 1 + 3;  // ids follow: any bits are fine
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(),
        -std::numeric_limits<float>::infinity()}) {
    for (std::size_t i = 0; i < kFloats; ++i) {
      std::string broken = bytes;
      std::memcpy(&broken[4 * i], &bad, sizeof bad);
      ASSERT_EQ(decode(broken, shape, 4).status().code(), absl::StatusCode::kInvalidArgument) << i;
    }
  }
}

TEST(FilmBlock, InvalidEnergiesAreRejected) {
  for (double FilmBlock::*energy : {&FilmBlock::clamped_energy, &FilmBlock::truncated_energy}) {
    FilmBlock block = FilmBlock::zeros({1, 1, 0, false});
    ASSERT_TRUE(decode(encode(block), block.shape, 4).ok());
    for (const double bad : {-1.0, std::numeric_limits<double>::infinity(),
                             std::numeric_limits<double>::quiet_NaN()}) {
      block.*energy = bad;
      EXPECT_FALSE(decode(encode(block), block.shape, 4).ok()) << bad;
    }
  }
}

TEST(FilmBlock, InvalidDroppedEntriesAreRejected) {
  FilmBlock block = FilmBlock::zeros({2, 1, 0, false});
  const auto fits = [&block](std::vector<DroppedSamples> dropped, std::int32_t samples) {
    block.dropped = std::move(dropped);
    return decode(encode(block), block.shape, samples).ok();
  };
  EXPECT_TRUE(fits({{0, 0, 2}, {0, 3, 1}, {1, 0, 2}}, 8));
  EXPECT_FALSE(fits({{2, 0, 1}}, 8)) << "no such pixel";
  EXPECT_FALSE(fits({{0, 4, 1}}, 8)) << "no such replicate";
  EXPECT_FALSE(fits({{0, 0, 0}}, 8)) << "a zero count";
  EXPECT_FALSE(fits({{0, 0, 3}}, 8)) << "two samples a replicate";
  EXPECT_FALSE(fits({{0, 1, 1}, {0, 0, 1}}, 8)) << "out of order";
  EXPECT_FALSE(fits({{0, 1, 1}, {0, 1, 1}}, 8)) << "twice";
  EXPECT_FALSE(fits({{0xFFFFFFFF, 0, 1}}, 8)) << "index that wraps";
}

TEST(FilmBlock, HugeDroppedCountDoesNotAllocate) {
  FilmBlock block = FilmBlock::zeros({1, 1, 0, false});
  std::string bytes = encode(block);
  const std::uint32_t huge = 0xFFFFFFFF;
  std::memcpy(&bytes[bytes.size() - 4], &huge, 4);
  EXPECT_FALSE(decode(bytes, block.shape, 4).ok());
}

TEST(FilmBlock, RandomBytesNeverCrash) {
  std::mt19937 rng(3);
  const FilmBlockShape shape{2, 1, kAovAlbedo | kAovIds, true};
  const std::string good = encode(random_block(shape, rng));
  int accepted = 0;
  for (int trial = 0; trial < 20'000; ++trial) {
    std::string bytes = good;
    for (int flips = 0; flips < 3; ++flips) {
      bytes[rng() % bytes.size()] = static_cast<char>(rng());
    }
    const absl::StatusOr<FilmBlock> block = decode(bytes, shape, 8);
    if (!block.ok()) continue;
    ++accepted;
    ASSERT_EQ(encode(*block), bytes);
  }
  EXPECT_GT(accepted, 1000) << "too few inputs pass the checks";
}

}  // namespace
}  // namespace tessera::contract
