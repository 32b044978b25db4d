// Pictures of before: each scene is known by the mean and the variance of its pixels, from many
// seeds. What a change of sampling may alter is the noise. `remake.sh` makes them anew.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>

#include "image/codecs/image_codec.h"
#include "server/film/exr_file.h"
#include "tests/support/seeded_frames.h"

namespace tessera::testing {
namespace {

constexpr std::int32_t kSize = 32, kBlock = 4, kSpp = 32;
constexpr int kSeeds = 32;  // of the kept mean and variance: 1, 2, …
constexpr std::uint32_t kTestedSeed = 1001;
constexpr std::int32_t kTests = 3 * (kSize / kBlock) * (kSize / kBlock);
constexpr double kFalseAlarms = 1e-3;  // of a scene whose image is right

contract::RenderSettings settings() {
  contract::RenderSettings s;
  s.width = s.height = s.tile = kSize;
  s.max_depth = 8;
  s.spp = kSpp;
  s.clamp = 1;  // the mean of a block is not normal where single samples decide it
  return s;
}

std::string kept_file(const std::string& scene, const char* what) {
  return std::string(TESSERA_GOLDEN) + "/" + scene + "." + what + ".exr";
}

void write_exr(const std::string& path, const Image& image) {
  const contract::PixelRect window{0, 0, kSize, kSize};
  std::vector<server::ExrPlane> planes;
  for (std::size_t c = 0; c < 3; ++c) {
    server::ExrPlane plane{std::string(1, "RGB"[c]), server::ExrType::float32, {}, {}};
    for (std::size_t i = c; i < image.size(); i += 3) {
      plane.values.push_back(static_cast<float>(image[i]));
    }
    planes.push_back(std::move(plane));
  }
  const auto file = server::ExrWriter::open(path, {window, window, {}, {}}, planes);
  ASSERT_TRUE(file.ok()) << file.status();
  ASSERT_TRUE((*file)->write_rows(kSize, planes).ok() && (*file)->close().ok()) << path;
}

Image read_exr(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << file.rdbuf();
  const std::string text = bytes.str();
  const auto pixels = image::decode(std::as_bytes(std::span(text)), {});
  EXPECT_TRUE(pixels.ok()) << path << ": " << pixels.status();
  if (!pixels.ok() || pixels->width != kSize || pixels->height != kSize) return {};
  return {pixels->f32.begin(), pixels->f32.end()};
}

/// The frame of one seed.
Image render(SeededRenderer& renderer, std::uint32_t seed) {
  EXPECT_TRUE(renderer.use_seed(seed).ok());
  return render_fixed(renderer, contract::TileGrid(settings()), kSpp, 0).image;
}

/// The mean of each block of pixels, in the place of all its pixels.
Image of_blocks(const Image& image) {
  Image blocks(image.size());
  const auto at = [](std::int32_t x, std::int32_t y, std::int32_t c) {
    return static_cast<std::size_t>(3 * (y * kSize + x) + c);
  };
  for (std::int32_t i = 0; i < kSize * kSize * 3; ++i) {
    const std::int32_t c = i % 3, x = i / 3 % kSize, y = i / 3 / kSize;
    const double share = image[static_cast<std::size_t>(i)] / (kBlock * kBlock);
    for (std::int32_t k = 0; k < kBlock * kBlock; ++k) {
      blocks[at(x / kBlock * kBlock + k % kBlock, y / kBlock * kBlock + k / kBlock, c)] += share;
    }
  }
  return blocks;
}

class Golden : public ::testing::TestWithParam<const char*> {};

void remake(SeededRenderer& renderer, const std::string& scene) {
  ImageMean frames;
  for (std::uint32_t seed = 1; seed <= kSeeds; ++seed) frames.add(render(renderer, seed));
  Image variance = frames.variance();
  for (double& value : variance) value *= kSeeds;  // of one frame
  write_exr(kept_file(scene, "mean"), frames.mean());
  write_exr(kept_file(scene, "variance"), variance);
}

TEST_P(Golden, MatchesReferenceWithinNoise) {
  const std::string scene = GetParam();
  SeededRenderer renderer(std::string(TESSERA_SCENES) + "/" + scene + ".gltf", settings());
  ASSERT_TRUE(renderer.load().ok());
  if (std::getenv("TESSERA_GOLDEN_REMAKE") != nullptr) return remake(renderer, scene);
  const Image mean = read_exr(kept_file(scene, "mean"));
  const Image variance = read_exr(kept_file(scene, "variance"));
  const Image image = render(renderer, kTestedSeed);
  ASSERT_EQ(mean.size(), image.size());
  ASSERT_EQ(variance.size(), image.size());
  const Image had = of_blocks(mean), got = of_blocks(image), spread = of_blocks(variance);
  // Šidák: so many independent tests, and one false alarm of them all with kFalseAlarms.
  const double least = 1 - std::pow(1 - kFalseAlarms, 1.0 / kTests);
  Image difference, p;
  double worst = 1;
  for (std::size_t i = 0; i < image.size(); ++i) {
    difference.push_back(got[i] - had[i]);
    // Of the mean of a block of the one frame, and of the kept frames' mean.
    const double deviation = std::sqrt(spread[i] / (kBlock * kBlock) * (1 + 1.0 / kSeeds));
    const double z = deviation > 0 ? difference[i] / deviation : difference[i] == 0 ? 0 : 1e9;
    p.push_back(std::erfc(std::fabs(z) / std::sqrt(2.0)));
    worst = std::min(worst, p.back());
  }
  if (worst >= least) return;
  const std::filesystem::path folder = "golden-failures";
  std::filesystem::create_directories(folder);
  const std::pair<const char*, const Image*> pictures[] = {
      {"image", &image}, {"reference", &mean}, {"difference", &difference}, {"p", &p}};
  for (const auto& [what, pixels] : pictures) {
    write_exr(folder / (scene + "." + what + ".exr"), *pixels);
  }
  ADD_FAILURE() << scene << ": a block of pixels has p = " << worst << ", below " << least
                << "; image, reference, difference and p-values are in "
                << std::filesystem::absolute(folder).string();
}

INSTANTIATE_TEST_SUITE_P(Scenes, Golden,
                         ::testing::Values("quickstart", "materials", "fog", "optics", "shapes"),
                         [](const auto& scene) { return std::string(scene.param); });

}  // namespace
}  // namespace tessera::testing
