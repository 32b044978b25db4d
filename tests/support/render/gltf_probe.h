#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "contract/render_settings.h"
#include "tests/support/scene/gltf_builder.h"
#include "worker/math/vector.h"

namespace tessera::testing {

/// A PNG of 8-bit RGBA codes, row by row from the top.
std::vector<std::byte> png(int width, int height, const std::vector<std::uint8_t>& rgba);

/// Starts a glTF file with an orthographic camera 5 m before the plane z = 0 that sees a tiny spot
/// of it along its normal.
std::unique_ptr<GltfBuilder> probe_of(double x, double y);

/// Adds a directional light of `lux` that shines along -z, down the camera's rays.
void add_sun(GltfBuilder& file, double lux);

/// Loads, poses and renders `file` as one pixel; returns the radiance. Fails the test and returns
/// NaN if the file is refused.
render::Vec3d seen(const GltfBuilder& file, const contract::RenderSettings& settings);

/// One pixel, 16 samples, one scattering event.
contract::RenderSettings probe_settings();

}  // namespace tessera::testing
