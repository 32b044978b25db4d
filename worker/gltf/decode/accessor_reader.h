#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/gltf/model/gltf_model.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Checks that accessor `index` lies within its views and buffers, including its sparse part, and
/// has a layout that glTF allows. `stored`: size of all buffers, bytes. Errors: InvalidArgument
/// "accessors[i]: ...".
absl::Status check_accessor(const GltfModel& model, std::int32_t index, std::uint64_t stored);

/// Runs check_accessor() for all accessors and adds the results to model.faults. Errors:
/// InvalidArgument if their total decoded size is above kMaxAccessorBytes plus 16 times the size of
/// the buffers.
absl::Status check_accessors(GltfModel& model);

/// Decoded size of accessor `index`, bytes.
std::uint64_t decoded_bytes(const GltfModel& model, std::int32_t index);

/// Checks that every view lies within its buffer; adds those that do not to model.faults and makes
/// them empty.
void check_views(GltfModel& model);

/// Elements of an accessor as floats, `components` each, in the order stored (matrices by column,
/// without padding). Normalised integers are decoded as the specification says, others converted.
/// Requires check_accessor(). Errors: InvalidArgument if the accessor has another number of
/// components, or a sparse index is out of order or range.
absl::StatusOr<std::vector<float>> read_floats(const GltfModel& model, std::int32_t index,
                                               int components);

/// Reads an accessor of unsigned integers as indices. Requires check_accessor().
absl::StatusOr<std::vector<std::uint32_t>> read_indices(const GltfModel& model, std::int32_t index);

/// read_floats() as vectors of 2, 3 or 4 floats.
absl::StatusOr<std::vector<Vec2f>> read_vec2(const GltfModel& model, std::int32_t index);
absl::StatusOr<std::vector<Vec3f>> read_vec3(const GltfModel& model, std::int32_t index);
absl::StatusOr<std::vector<Vec4f>> read_vec4(const GltfModel& model, std::int32_t index);

}  // namespace tessera::render
