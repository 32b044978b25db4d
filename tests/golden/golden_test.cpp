// Golden images: the mean and variance of each pixel over many seeds, of unclamped samples. A
// change of sampling may alter the noise only. `remake.sh` renders the references again.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "image/codecs/image_codec.h"
#include "image/exr/exr_file.h"
#include "tests/support/render/seeded_frames.h"

namespace tessera::testing {
namespace {

constexpr std::int32_t kSize = 32, kBlock = 4, kSpp = 32;
constexpr int kReferenceSeeds = 32;  // 1, 2, …
constexpr int kTestedSeeds = 8;      // 1001, 1002, …
constexpr std::uint32_t kFirstTestedSeed = 1001;
constexpr std::int32_t kTests = 3 * (kSize / kBlock) * (kSize / kBlock);
constexpr double kFalseAlarmRate = 1e-3;  // per scene
/// References are stored as floats, 2^-24 of their value off; sums of 16 pixels stay below this.
constexpr double kRounding = 1e-6;

contract::RenderSettings settings() {
  contract::RenderSettings s;
  s.width = s.height = s.tile = kSize;
  s.max_depth = 8;
  s.spp = kSpp;
  return s;
}

std::string reference_file(const std::string& scene, const char* what) {
  return absl::StrCat(TESSERA_GOLDEN, "/", scene, ".", what, ".exr");
}

void write_exr(const std::string& path, const Image& image) {
  const contract::PixelRect window{0, 0, kSize, kSize};
  std::vector<image::ExrPlane> planes;
  for (std::size_t c = 0; c < 3; ++c) {
    image::ExrPlane plane{std::string(1, "RGB"[c]), image::ExrType::float32, {}, {}};
    for (std::size_t i = c; i < image.size(); i += 3) {
      plane.values.push_back(static_cast<float>(image[i]));
    }
    planes.push_back(std::move(plane));
  }
  const auto file = image::ExrWriter::open(path, {window, window, {}, {}, {}}, planes);
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

/// Mean and variance per pixel and channel of frames with `count` seeds from `first` on.
struct Frames {
  Image mean, variance;  // variance of one frame
};
Frames render(SeededRenderer& renderer, std::uint32_t first, int count) {
  ImageMean frames;
  for (int i = 0; i < count; ++i) {
    EXPECT_TRUE(renderer.use_seed(first + static_cast<std::uint32_t>(i)).ok());
    frames.add(render_fixed(renderer, contract::TileGrid(settings()), kSpp, 0).image);
  }
  Frames out{frames.mean(), frames.variance()};
  for (double& value : out.variance) value *= count;  // ImageMean: of the mean
  return out;
}

/// The mean of each block of pixels, stored at all its pixels.
Image block_means(const Image& image) {
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

/// Probability of a Student t variable with `degrees` degrees of freedom beyond ±t.
/// Source: D. L. Wallace, "Bounds on normal approximations to Student's and the chi-square
/// distributions", 1959; good to 1 % of the probability for the 38 degrees used here.
double two_sided_p(double t, double degrees) {
  const double z =
      std::sqrt(degrees * std::log1p(t * t / degrees)) * (8 * degrees + 1) / (8 * degrees + 3);
  return std::erfc(z / std::sqrt(2.0));
}

class Golden : public ::testing::TestWithParam<const char*> {};

void remake(SeededRenderer& renderer, const std::string& scene) {
  const Frames frames = render(renderer, 1, kReferenceSeeds);
  write_exr(reference_file(scene, "mean"), frames.mean);
  write_exr(reference_file(scene, "variance"), frames.variance);
}

/// Student's t-test of each block with the pooled variance of reference and tested frames. A single
/// bright sample raises the difference and the variance alike, so that unclamped frames can be
/// compared: alone in one of the tested frames it gives t = 2.1 at most.
TEST_P(Golden, MatchesReferenceWithinNoise) {
  const std::string scene = GetParam();
  SeededRenderer renderer(absl::StrCat(TESSERA_SCENES, "/", scene, ".gltf"), settings());
  ASSERT_TRUE(renderer.load().ok());
  if (std::getenv("TESSERA_GOLDEN_REMAKE") != nullptr) return remake(renderer, scene);
  const Image reference = read_exr(reference_file(scene, "mean"));
  const Image reference_variance = read_exr(reference_file(scene, "variance"));
  const Frames tested = render(renderer, kFirstTestedSeed, kTestedSeeds);
  ASSERT_EQ(reference.size(), tested.mean.size());
  ASSERT_EQ(reference_variance.size(), tested.mean.size());
  const Image expected = block_means(reference), found = block_means(tested.mean);
  const Image expected_variance = block_means(reference_variance);
  const Image found_variance = block_means(tested.variance);
  // Šidák: each of kTests independent tests has this false alarm rate.
  const double least_p = 1 - std::pow(1 - kFalseAlarmRate, 1.0 / kTests);
  constexpr double kDegrees = kReferenceSeeds + kTestedSeeds - 2;
  Image difference, p;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    difference.push_back(found[i] - expected[i]);
    const double pooled =
        ((kReferenceSeeds - 1) * expected_variance[i] + (kTestedSeeds - 1) * found_variance[i]) /
        kDegrees / (kBlock * kBlock);
    const double deviation = std::hypot(
        std::sqrt(pooled * (1.0 / kReferenceSeeds + 1.0 / kTestedSeeds)), kRounding * expected[i]);
    p.push_back(difference[i] == 0 ? 1 : two_sided_p(difference[i] / deviation, kDegrees));
  }
  const double worst = *std::min_element(p.begin(), p.end());
  if (worst >= least_p) return;
  const std::filesystem::path folder = "golden-failures";
  std::filesystem::create_directories(folder);
  const std::pair<const char*, const Image*> images[] = {
      {"image", &tested.mean}, {"reference", &reference}, {"difference", &difference}, {"p", &p}};
  for (const auto& [name, pixels] : images) {
    write_exr(folder / (scene + "." + name + ".exr"), *pixels);
  }
  ADD_FAILURE() << scene << ": a block of pixels has p = " << worst << ", below " << least_p
                << "; image, reference, difference and p-values are in "
                << std::filesystem::absolute(folder).string();
}

INSTANTIATE_TEST_SUITE_P(Scenes, Golden,
                         ::testing::Values("quickstart", "materials", "fog", "optics", "shapes"),
                         [](const auto& scene) { return std::string(scene.param); });

}  // namespace
}  // namespace tessera::testing
