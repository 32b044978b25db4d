#pragma once

#include <string>
#include <vector>

#include "tests/support/scene/gltf_builder.h"
#include "tests/support/scene/plain_scene.h"

namespace tessera::render::testing {

inline std::string number(int n) {
  return std::to_string(n);
}

/// Animates `path` of a node from 0 s to the last of `times`.
inline void animate(tessera::testing::GltfBuilder& file, int node, const std::string& path,
                    const std::vector<float>& times, const char* type,
                    const std::vector<float>& values, const std::string& interpolation = "LINEAR") {
  const int input = file.add_floats("SCALAR", times), output = file.add_floats(type, values);
  file.add("animations", R"({"samplers": [{"input": )" + number(input) + R"(, "output": )" +
                             number(output) + R"(, "interpolation": ")" + interpolation +
                             R"("}], "channels": [{"sampler": 0, "target": {"node": )" +
                             number(node) + R"(, "path": ")" + path + R"("}}]})");
}

/// A row of 24 pixels.
inline contract::RenderSettings all_animations() {
  contract::RenderSettings settings = tessera::testing::small_settings(24, 1, 4);
  settings.animation = "all";
  return settings;
}

/// A camera at z = 5, whose shutter is open from `open` to `close` if these differ.
inline int add_camera(tessera::testing::GltfBuilder& file, double open, double close) {
  std::string extension;
  if (open < close) {
    file.use_extension("TESSERA_camera");
    extension = R"(, "extensions": {"TESSERA_camera": {"shutter": {"open": )" +
                std::to_string(open) + R"(, "close": )" + std::to_string(close) + "}}}";
  }
  file.add("cameras", R"({"type": "perspective", "perspective": {"yfov": 0.025, "znear": 0.01})" +
                          extension + "}");
  return file.add_node(R"({"camera": 0, "translation": [0, 0, 5]})");
}

}  // namespace tessera::render::testing
