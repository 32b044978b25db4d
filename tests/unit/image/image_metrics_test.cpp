#include "image/metrics/image_metrics.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace tessera::contract {
namespace {

/// An image of one colour on which tests paint.
struct Canvas {
  std::int32_t width, height;
  std::vector<float> rgba;

  Canvas(std::int32_t w, std::int32_t h, std::array<float, 3> color) : width(w), height(h) {
    for (std::int32_t i = 0; i < w * h; ++i) {
      rgba.insert(rgba.end(), {color[0], color[1], color[2], 1});
    }
  }
  float& at(std::int32_t x, std::int32_t y, std::int32_t channel) {
    return rgba[static_cast<std::size_t>(4 * (std::int64_t{y} * width + x) + channel)];
  }
  ImageView view() const { return {width, height, rgba}; }
};

ImageDifference difference(const Canvas& image, const Canvas& reference) {
  const auto result = compare_images(image.view(), reference.view());
  EXPECT_TRUE(result.ok()) << result.status();
  return result.ok() ? *result : ImageDifference{};
}

TEST(CompareImages, EqualImagesHaveZeroDifference) {
  const Canvas image(9, 5, {0.2f, 3, 0});
  const ImageDifference none = difference(image, image);
  EXPECT_EQ(none.rmse, 0);
  EXPECT_EQ(none.relmse, 0);
  EXPECT_EQ(none.error, 0);
  EXPECT_FALSE(none.psnr_db) << "infinite";
  EXPECT_EQ(none.flip, 0);
  EXPECT_EQ(none.largest, 0);
}

TEST(CompareImages, GreyStepMatchesFormulas) {
  // x = 0.5, ref = 0.25 everywhere; m = 0.25.
  const ImageDifference found =
      difference(Canvas(4, 4, {0.5f, 0.5f, 0.5f}), Canvas(4, 4, {0.25f, 0.25f, 0.25f}));
  EXPECT_NEAR(found.rmse, 0.25, 1e-12);
  EXPECT_NEAR(found.relmse, 0.0625 / (0.0625 + 0.01), 1e-12);
  EXPECT_NEAR(*found.error, std::sqrt(0.0625 / (0.0625 + 0.01 * 0.0625)), 1e-12);
  // sRGB codes 0.735357 and 0.537099.
  EXPECT_NEAR(*found.psnr_db, -20 * std::log10(0.7353569831 - 0.5370987304), 1e-6);
}

TEST(CompareImages, ErrorIsScaleFreeButRelmseIsNot) {
  std::mt19937 rng(4);
  Canvas image(8, 8, {0, 0, 0}), reference = image;
  for (std::size_t i = 0; i < image.rgba.size(); ++i) {
    image.rgba[i] = static_cast<float>(rng() % 1000);
    reference.rgba[i] = static_cast<float>(rng() % 1000);
  }
  const ImageDifference large = difference(image, reference);
  for (auto* values : {&image.rgba, &reference.rgba}) {
    for (float& value : *values) value *= 0x1p-10f;
  }
  const ImageDifference small = difference(image, reference);
  EXPECT_NEAR(*small.error, *large.error, 1e-9 * *large.error);
  EXPECT_NEAR(small.rmse, large.rmse / 1024, 1e-9 * large.rmse);
  EXPECT_NE(small.relmse, large.relmse);
}

TEST(CompareImages, BlackReferenceHasNoRelativeError) {
  const ImageDifference found = difference(Canvas(2, 2, {1, 1, 1}), Canvas(2, 2, {0, 0, 0}));
  EXPECT_FALSE(found.error);
  EXPECT_NEAR(found.relmse, 100, 1e-9);
}

TEST(CompareImages, FindsFirstLargestDifference) {
  Canvas image(7, 5, {0.5f, 0.5f, 0.5f});
  const Canvas reference = image;
  image.at(6, 1, 2) += 0.25f;
  image.at(2, 3, 0) -= 0.25f;
  const ImageDifference found = difference(image, reference);
  EXPECT_EQ(found.largest, 0.25);
  EXPECT_EQ(found.largest_x, 6);
  EXPECT_EQ(found.largest_y, 1);
  EXPECT_EQ(found.largest_channel, 2);
}

TEST(CompareImages, AlphaCountsOnlyForLargest) {
  Canvas image(2, 1, {0.5f, 0.5f, 0.5f});
  const Canvas reference = image;
  image.at(1, 0, 3) = 0;
  const ImageDifference found = difference(image, reference);
  EXPECT_EQ(found.rmse, 0);
  EXPECT_EQ(found.largest, 1);
  EXPECT_EQ(found.largest_channel, 3);
}

TEST(CompareImages, NonFiniteValueIsLocated) {
  const Canvas good(4, 3, {1, 1, 1});
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    Canvas broken = good;
    broken.at(3, 2, 1) = bad;
    const auto first = compare_images(broken.view(), good.view()).status();
    EXPECT_EQ(first.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(std::string(first.message()), "first image: G of pixel (3, 2) is not finite");
    EXPECT_FALSE(compare_images(good.view(), broken.view()).ok());
  }
}

TEST(CompareImages, RejectsDifferentSizes) {
  const Canvas wide(4, 3, {1, 1, 1}), tall(3, 4, {1, 1, 1});
  EXPECT_FALSE(compare_images(wide.view(), tall.view()).ok());
  EXPECT_FALSE(compare_images({4, 4, wide.rgba}, wide.view()).ok()) << "pixels are missing";
}

TEST(Flip, BlackAgainstWhiteMatchesFormula) {
  // Constant images pass the filters unchanged and have no features. HyAB is 100; that of green
  // and blue is 203.35 (Lab 87.74, −86.18, 83.18 and 32.30, 79.19, −107.86, times 0.01 L). To the
  // power 0.7: 25.119 and 41.276; the knee is at 0.4 · 41.276.
  const double largest = 41.276, distance = std::pow(100, 0.7);
  const double expected = 0.95 + (distance - 0.4 * largest) / (0.6 * largest) * 0.05;
  EXPECT_NEAR(mean_flip(Canvas(8, 8, {0, 0, 0}).view(), Canvas(8, 8, {1, 1, 1}).view()), expected,
              1e-4);
}

TEST(Flip, SmallGreyStepIsBelowKnee) {
  // Y 0.18 and 0.20: L 49.496 and 51.837; (2.341)^0.7 · 0.95 / (0.4 · 41.276) = 0.10439.
  const auto lightness = [](double y) { return 116 * std::cbrt(y) - 16; };
  const double expected = std::pow(lightness(0.20) - lightness(0.18), 0.7) * 0.95 / (0.4 * 41.276);
  EXPECT_NEAR(mean_flip(Canvas(3, 3, {0.18f, 0.18f, 0.18f}).view(),
                        Canvas(3, 3, {0.20f, 0.20f, 0.20f}).view()),
              expected, 1e-5);
}

TEST(Flip, GreenAgainstBlueIsOne) {
  EXPECT_NEAR(mean_flip(Canvas(2, 2, {0, 1, 0}).view(), Canvas(2, 2, {0, 0, 1}).view()), 1, 1e-12);
}

Canvas noisy(std::uint32_t seed) {
  std::mt19937 rng(seed);
  Canvas image(40, 30, {0, 0, 0});
  for (float& value : image.rgba) value = static_cast<float>(rng() % 1001) / 1000;
  return image;
}

TEST(Flip, IsSymmetricAndBounded) {
  const Canvas a = noisy(5), b = noisy(6);
  const double forward = mean_flip(a.view(), b.view());
  EXPECT_NEAR(forward, mean_flip(b.view(), a.view()), 1e-12);
  EXPECT_GT(forward, 0);
  EXPECT_LT(forward, 1);
  const Canvas white(5, 5, {1, 1, 1}), brighter(5, 5, {50, 50, 50});
  EXPECT_EQ(mean_flip(white.view(), brighter.view()), 0);
}

TEST(Flip, RotatesAndMirrorsWithImages) {
  const Canvas a = noisy(7), b = noisy(8);
  Canvas mirrored_a = a, mirrored_b = b, turned_a(30, 40, {0, 0, 0}), turned_b = turned_a;
  for (std::int32_t y = 0; y < 30; ++y) {
    for (std::int32_t x = 0; x < 40; ++x) {
      for (std::int32_t c = 0; c < 4; ++c) {
        mirrored_a.at(39 - x, y, c) =
            Canvas(a).rgba[static_cast<std::size_t>(4 * (std::int64_t{y} * 40 + x) + c)];
        mirrored_b.at(39 - x, y, c) =
            Canvas(b).rgba[static_cast<std::size_t>(4 * (std::int64_t{y} * 40 + x) + c)];
        turned_a.at(y, x, c) = a.rgba[static_cast<std::size_t>(4 * (std::int64_t{y} * 40 + x) + c)];
        turned_b.at(y, x, c) = b.rgba[static_cast<std::size_t>(4 * (std::int64_t{y} * 40 + x) + c)];
      }
    }
  }
  const double upright = mean_flip(a.view(), b.view());
  EXPECT_NEAR(mean_flip(mirrored_a.view(), mirrored_b.view()), upright, 1e-12);
  EXPECT_NEAR(mean_flip(turned_a.view(), turned_b.view()), upright, 1e-12);
}

TEST(Flip, FineDetailCountsLessThanCoarse) {
  // At 67 pixels per degree the eye cannot resolve a red-green checker of one pixel.
  const auto checker = [](std::int32_t size) {
    Canvas image(64, 64, {0.5f, 0.5f, 0.5f});
    for (std::int32_t y = 0; y < 64; ++y) {
      for (std::int32_t x = 0; x < 64; ++x) {
        const float sign = ((x / size) + (y / size)) % 2 == 0 ? 1.0f : -1.0f;
        image.at(x, y, 0) = 0.5f + 0.1f * sign;
        image.at(x, y, 1) = 0.5f - 0.03f * sign;
      }
    }
    return image;
  };
  const Canvas grey(64, 64, {0.5f, 0.5f, 0.5f});
  const double fine = mean_flip(checker(1).view(), grey.view());
  const double coarse = mean_flip(checker(16).view(), grey.view());
  EXPECT_LT(fine, 0.5 * coarse);
}

TEST(Flip, BlueYellowBlursMoreThanRedGreen) {
  // The widest sensitivity filter (b = 0.04) has σ = 3 pixels here, the others about 1: a checker
  // of four pixels fades in blue and yellow, but not in red and green.
  const auto checker = [](std::array<float, 3> step) {
    Canvas image(64, 64, {0.5f, 0.5f, 0.5f});
    for (std::int32_t y = 0; y < 64; ++y) {
      for (std::int32_t x = 0; x < 64; ++x) {
        const float sign = ((x / 4) + (y / 4)) % 2 == 0 ? 1.0f : -1.0f;
        for (std::int32_t c = 0; c < 3; ++c) {
          image.at(x, y, c) += sign * step[static_cast<std::size_t>(c)];
        }
      }
    }
    return image;
  };
  const Canvas grey(64, 64, {0.5f, 0.5f, 0.5f});
  // Both at constant luminance, so that only colour differs.
  const double red_green = mean_flip(checker({0.1f, -0.0297f, 0}).view(), grey.view());
  const double blue_yellow = mean_flip(checker({-0.0156f, -0.0156f, 0.2f}).view(), grey.view());
  EXPECT_LT(blue_yellow, red_green) << "without the filter the step is much larger";
}

TEST(Flip, LostEdgeCountsMoreThanEqualStep) {
  // Feature differences raise the result: where an edge is missing, the exponent 1 − ΔF falls below
  // 1.
  Canvas edge(64, 64, {0.3f, 0.3f, 0.3f});
  for (std::int32_t y = 0; y < 64; ++y) {
    for (std::int32_t x = 32; x < 64; ++x) {
      for (std::int32_t c = 0; c < 3; ++c) edge.at(x, y, c) = 0.6f;
    }
  }
  const Canvas dark(64, 64, {0.3f, 0.3f, 0.3f}), light(64, 64, {0.6f, 0.6f, 0.6f});
  const double half_of_step = 0.5 * mean_flip(light.view(), dark.view());
  EXPECT_GT(mean_flip(edge.view(), dark.view()), 1.05 * half_of_step);
}

}  // namespace
}  // namespace tessera::contract
