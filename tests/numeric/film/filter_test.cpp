// Hard cases 67 and 72: pixel filters and tiles, and sums of many samples.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "tests/support/scene/plain_scene.h"
#include "worker/render/pixel_sums.h"
#include "worker/sampling/hash.h"

namespace tessera::testing {
namespace {

using contract::PixelFilter;
using render::Scene;

/// An orthographic view of one white square that covers exactly the pixel (7, 9) of 16 x 16.
Scene white_spike() {
  Scene scene = empty_scene();
  render::Material white = lambert({0, 0, 0});
  white.emission = {1, 1, 1};
  const auto material = add_material(&scene, white);
  add_primitive(&scene, quad({-1, -2, 0}, {1, 0, 0}, {0, 1, 0}, material));
  scene.camera.kind = render::Camera::Kind::orthographic;
  scene.camera.ymag = 8;
  return scene;
}

contract::RenderSettings filtered(PixelFilter filter, double width) {
  contract::RenderSettings settings = small_settings(16, 16, 1024);
  settings.filter = filter;
  settings.filter_width = width;
  return settings;
}

struct FilterCase {
  PixelFilter filter;
  double width;
};
constexpr FilterCase kFilters[] = {{PixelFilter::box, 1},
                                   {PixelFilter::box, 2.5},
                                   {PixelFilter::gaussian, 3},
                                   {PixelFilter::blackman_harris, 4}};

TEST(PixelFilterOnFilm, SpikeKeepsItsSum) {  // hard case 72
  for (const auto& [filter, width] : kFilters) {
    const Picture picture = render_picture(white_spike(), filtered(filter, width));
    double sum = 0, variance = 0;
    for (std::size_t i = 0; i < picture.rgb.size(); i += 3) {
      sum += picture.rgb[i];
      variance += picture.error[i] * picture.error[i];
    }
    EXPECT_NEAR(sum, 1, 4 * std::sqrt(variance) + 1e-6) << width;
    EXPECT_LT(std::sqrt(variance), 5e-3) << width;
    EXPECT_NEAR(picture.at(7, 9).x, width == 1 ? 1 : picture.at(7, 9).y, 1e-9);
    EXPECT_GT(picture.at(7, 9).x, 0.1) << "the spike is in its pixel";
    if (width > 1) {
      EXPECT_GT(picture.at(8, 9).x, 1e-3) << "and beside it";
    }
  }
}

TEST(PixelFilterOnFilm, TilesOfEverySizeGiveSameBits) {  // hard case 72
  constexpr std::int32_t kSide = 80;                     // not a multiple of 64
  for (const auto& [filter, width] : kFilters) {
    auto settings = filtered(filter, width);
    settings.width = settings.height = kSide;
    auto renderer = render::FrameRenderer::create(white_spike(), settings, 0, render::sequential());
    ASSERT_TRUE(renderer.ok());
    const contract::Pass pass{0, 8};
    const auto whole = (*renderer)->render({0, 0, kSide, kSide}, pass, 0, render::sequential());
    for (const std::int32_t tile : {8, 16, 64}) {
      for (std::int32_t y = 0; y < kSide; y += tile) {
        for (std::int32_t x = 0; x < kSide; x += tile) {
          const contract::PixelRect rect = {x, y, std::min(tile, kSide - x),
                                            std::min(tile, kSide - y)};
          const auto part = (*renderer)->render(rect, pass, 0, render::sequential());
          constexpr std::size_t kPerPixel = std::size_t{3} * contract::kReplicates;
          for (std::int32_t row = 0; row < rect.height; ++row) {
            const auto from = static_cast<std::size_t>((row + y) * kSide + x) * kPerPixel;
            const auto to = static_cast<std::size_t>(row * rect.width) * kPerPixel;
            for (std::size_t i = 0; i < static_cast<std::size_t>(rect.width) * kPerPixel; ++i) {
              ASSERT_EQ(part.rgb[to + i], whole.rgb[from + i]) << tile << " " << x << " " << y;
            }
          }
        }
      }
    }
  }
}

TEST(PixelSums, LongSumsStayWithinRounding) {  // hard case 67
  constexpr std::int32_t kCount = 100'000'000;
  render::PixelSums sums;
  render::PathResult path;
  // One sample in a million is a million times as bright; the others vary from 0.1 to 0.2, so that
  // sums in double round. A long double holds them to 2^-64.
  std::array<long double, contract::kReplicates> exact{};
  for (std::int32_t i = 0; i < kCount; ++i) {
    const auto step = static_cast<float>(render::mix(static_cast<std::uint64_t>(i)) >> 40);
    const float radiance = (i % 1'000'000 == 7 ? 1e6f : 1) * (0.1f + 0.1f * 0x1p-24f * step);
    path.radiance = {radiance, 0.5f, 0};
    path.truncated = {radiance, 0, 0};
    exact[static_cast<std::size_t>(i) % contract::kReplicates] +=
        static_cast<long double>(radiance);
    sums.add(path, i, 0);
  }
  contract::FilmBlockShape shape;
  shape.width = shape.height = 1;
  contract::FilmBlock block = contract::FilmBlock::zeros(shape);
  sums.store(0, &block);
  long double total = 0;
  for (std::size_t r = 0; r < contract::kReplicates; ++r) {
    total += exact[r];
    EXPECT_NEAR(static_cast<double>(block.rgb[3 * r] / exact[r]), 1, 0x1p-24 + 1e-12) << r;
    EXPECT_EQ(block.rgb[3 * r + 1], 0.5 * kCount / contract::kReplicates) << r;
  }
  // Where roundings are independent: 2^-53 times the root of their number. No sum is worse than
  // 2^-53 times the number, 1.1e-8, which is less than one rounding to float.
  EXPECT_NEAR(static_cast<double>(sums.truncated_energy() / total), 1, 1e-12);
}

}  // namespace
}  // namespace tessera::testing
