#pragma once

#include "worker/gltf/validate/findings/json_tree.h"

namespace tessera::render {

/// Rules for the transforms of nodes, evaluated in single precision with the tolerances of the
/// Khronos glTF validator, so that both agree on files whose numbers are rounded.

/// Largest deviation of a quaternion's length from 1.
inline constexpr double kQuaternionTolerance = 0.00769;

/// Requires an array of 4 numbers.
bool is_unit_quaternion(const JsonNode& rotation);

/// Require an array of 16 numbers, by column.
bool is_identity_matrix(const JsonNode& matrix);
/// Whether a matrix is a translation, rotation and scale: it equals what its parts give.
bool is_decomposable_matrix(const JsonNode& matrix);

}  // namespace tessera::render
