#include "tests/support/render/gltf_probe.h"

#include <gtest/gtest.h>

#include <limits>

#include "image/codecs/image_codec.h"
#include "tests/support/scene/memory_scene.h"
#include "tests/support/scene/plain_scene.h"

namespace tessera::testing {

std::vector<std::byte> png(int width, int height, const std::vector<std::uint8_t>& rgba) {
  const auto encoder = image::make_encoder(image::ImageFormat::png, width, height);
  EXPECT_TRUE(encoder->write_rows(rgba.data(), height).ok());
  const auto file = encoder->finish();
  EXPECT_TRUE(file.ok()) << file.status();
  const auto bytes = std::as_bytes(std::span(*file));
  return {bytes.begin(), bytes.end()};
}

std::unique_ptr<GltfBuilder> probe_of(double x, double y) {
  auto file = std::make_unique<GltfBuilder>();
  file->add("cameras", R"({"type": "orthographic", "orthographic":
                           {"xmag": 1e-8, "ymag": 1e-8, "znear": 0.01, "zfar": 100}})");
  file->add_node(R"({"camera": 0, "translation": [)" + std::to_string(x) + ", " +
                 std::to_string(y) + ", 5]}");
  return file;
}

void add_sun(GltfBuilder& file, double lux) {
  file.use_extension("KHR_lights_punctual");
  file.set("/extensions/KHR_lights_punctual/lights",
           R"([{"type": "directional", "intensity": )" + std::to_string(lux) + "}]");
  file.add_node(R"({"extensions": {"KHR_lights_punctual": {"light": 0}}})");
}

render::Vec3d seen(const GltfBuilder& file, const contract::RenderSettings& settings) {
  auto scene = load_and_pose(file, settings);
  EXPECT_TRUE(scene.ok()) << scene.status();
  constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  if (!scene.ok()) return {kNothing, kNothing, kNothing};
  return render_picture(*std::move(scene), settings).at(0, 0);
}

contract::RenderSettings probe_settings() {
  contract::RenderSettings settings = small_settings(1, 1, 16);
  settings.max_depth = 1;
  return settings;
}

}  // namespace tessera::testing
