#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "tests/support/scene/gltf_builder.h"

namespace tessera::render::testing {

constexpr double kOpen = 0.1, kClose = 0.9;  // exposure of blurred images, seconds

/// An emissive, double-sided material.
int shining(tessera::testing::GltfBuilder& b, const std::string& color);

/// An upright mesh at z = 0 that begins at x, 2 m high.
int add_stripe(tessera::testing::GltfBuilder& b, float x, float width, int material);

/// A white wall at z = -1.
void add_wall(tessera::testing::GltfBuilder& b);

/// A file whose camera has a shutter from `open` to `close`, or none if these are equal.
using FileMaker = std::unique_ptr<tessera::testing::GltfBuilder> (*)(double open, double close);

/// Expects `pictures` blurred images to equal the average of many sharp ones, each of the file
/// without a shutter at a time of its own.
void expect_average(FileMaker make, std::uint32_t pictures);

}  // namespace tessera::render::testing
