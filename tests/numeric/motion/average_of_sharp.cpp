#include "tests/numeric/motion/average_of_sharp.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "tests/numeric/motion/motion_files.h"
#include "tests/support/scene/memory_scene.h"
#include "worker/gltf/build/loader.h"

namespace tessera::render::testing {

using tessera::testing::GltfBuilder;
using tessera::testing::load_and_pose;
using tessera::testing::Picture;
using tessera::testing::render_picture;

namespace {

/// Mean and squared standard error of a pixel's channels over independent images.
struct Estimate {
  std::vector<double> sum, squares;
  double count = 0;
  void add(const std::vector<double>& rgb) {
    sum.resize(rgb.size());
    squares.resize(rgb.size());
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      sum[i] += rgb[i];
      squares[i] += rgb[i] * rgb[i];
    }
    ++count;
  }
  double mean(std::size_t i) const { return sum[i] / count; }
  double error2(std::size_t i) const {
    return std::max(squares[i] / count - mean(i) * mean(i), 0.0) / (count - 1);
  }
};

}  // namespace

int shining(GltfBuilder& b, const std::string& color) {
  return b.add_material(R"({"emissiveFactor": )" + color +
                        R"(, "doubleSided": true, "pbrMetallicRoughness": {"metallicFactor": 0}})");
}

int add_stripe(GltfBuilder& b, float x, float width, int material) {
  tessera::testing::TriangleMesh mesh;
  mesh.positions = {{x, -1, 0}, {x + width, -1, 0}, {x + width, 1, 0}, {x, 1, 0}};
  mesh.indices = {0, 1, 2, 0, 2, 3};
  mesh.material = material;
  return b.add_mesh(mesh);
}

void add_wall(GltfBuilder& b) {
  const int paint = b.add_material(R"({"pbrMetallicRoughness": {"metallicFactor": 0}})");
  b.add_node_with_mesh(add_stripe(b, -9, 18, paint), R"({"translation": [0, 0, -1]})");
}

void expect_average(FileMaker make, std::uint32_t pictures) {
  constexpr double kTick = 1e-6;
  constexpr int kTimes = 32;  // strata
  const auto blurred = make(kOpen, kClose), sharp = make(0, 0);
  auto settings = all_animations();
  settings.max_depth = 1;
  settings.fps = 1 / kTick;
  const auto scene = load_and_pose(*blurred, settings);
  ASSERT_TRUE(scene.ok()) << scene.status();
  tessera::testing::MemoryReader reader;
  reader.put("scene.gltf", sharp->gltf());
  const auto file = load_scene_file("scene.gltf", settings, reader);
  ASSERT_TRUE(file.ok()) << file.status();
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  Estimate blur, average;
  for (std::uint32_t seed = 0; seed < pictures; ++seed) {
    settings.seed = seed;
    settings.spp = 512;
    blur.add(render_picture(*scene, settings).rgb);
    settings.spp = 8;
    std::vector<double> sum;
    for (int i = 0; i < kTimes; ++i) {
      const double time = kOpen + (i + uniform(rng)) / kTimes * (kClose - kOpen);
      settings.seed = 1000 + seed * kTimes + static_cast<std::uint32_t>(i);
      const auto now =
          (*file)->pose(settings, static_cast<std::int32_t>(std::lround(time / kTick)));
      ASSERT_TRUE(now.ok()) << now.status();
      const Picture one = render_picture(*now, settings);
      sum.resize(one.rgb.size());
      for (std::size_t k = 0; k < sum.size(); ++k) sum[k] += one.rgb[k] / kTimes;
    }
    average.add(sum);
  }
  settings.spp = 8 * kTimes;
  const auto middle =
      (*file)->pose(settings, static_cast<std::int32_t>(std::lround((kOpen + kClose) / 2 / kTick)));
  ASSERT_TRUE(middle.ok()) << middle.status();
  const Picture frozen = render_picture(*middle, settings);
  double largest = 0, largest_if_frozen = 0;
  const std::size_t count = blur.sum.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double error = std::sqrt(blur.error2(i) + average.error2(i));
    const double off = std::abs(blur.mean(i) - average.mean(i));
    if (off > 1e-6) largest = std::max(largest, off / error);
    const double off_if_frozen = std::abs(frozen.rgb[i] - average.mean(i));
    if (off_if_frozen > 1e-6)
      largest_if_frozen = std::max(largest_if_frozen, off_if_frozen / error);
  }
  // The largest of 72 values of t with 15 degrees of freedom exceeds 5.1 once in 100 times. Paths
  // deviate by at most 4/3 2^-10 of 2 m, a fiftieth of a pixel.
  EXPECT_LT(largest, 5.1);
  EXPECT_GT(largest_if_frozen, 2 * 5.1) << "a frozen object would not be detected";
}

}  // namespace tessera::render::testing
