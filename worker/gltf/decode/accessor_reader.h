#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "worker/math/vector.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Checks that accessor `index` lies within its views and buffers, sparse part included, without
/// overflow, and that its layout is one glTF allows. Errors: InvalidArgument "accessors[i]: ...".
absl::Status check_accessor(const GltfModel& document, std::int32_t index);

/// check_accessor() for all, and that together they decode to no more than kMaxAccessorBytes and
/// 16 times the buffers.
absl::Status check_accessors(const GltfModel& document);

/// Bytes that accessor `index` decodes to.
std::uint64_t decoded_bytes(const GltfModel& document, std::int32_t index);

/// Checks that every view lies within its buffer.
absl::Status check_views(const GltfModel& document);

/// Elements of an accessor as floats, `components` each, row-major as stored (matrices column by
/// column, padding skipped); normalised integers decoded as the specification says, others
/// converted. Requires check_accessor().
/// Errors: InvalidArgument when the accessor has another number of components, or a sparse index
/// is out of order or range.
absl::StatusOr<std::vector<float>> read_floats(const GltfModel& document, std::int32_t index,
                                               int components);

/// An accessor of unsigned integers as indices. Requires check_accessor().
absl::StatusOr<std::vector<std::uint32_t>> read_indices(const GltfModel& document,
                                                        std::int32_t index);

/// read_floats() into vectors.
absl::StatusOr<std::vector<Vec2f>> read_vec2(const GltfModel& document, std::int32_t index);
absl::StatusOr<std::vector<Vec3f>> read_vec3(const GltfModel& document, std::int32_t index);
absl::StatusOr<std::vector<Vec4f>> read_vec4(const GltfModel& document, std::int32_t index);

}  // namespace tessera::render
