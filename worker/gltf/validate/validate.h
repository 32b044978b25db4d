#pragma once

#include <cstddef>
#include <span>

#include "worker/gltf/file/resource_reader.h"
#include "worker/gltf/validate/findings/findings.h"

namespace tessera::render {

/// Number of findings that `tessera inspect --validate` lists.
inline constexpr std::size_t kMaxFindings = 100;

/// Result of the validation of a file.
struct ValidationResult {
  ValidationFindings findings;
  /// Some values of accessors or nodes of scenes were not checked, as they would take too long.
  bool is_partial = false;
};

/// Checks a glTF or GLB file against glTF 2.0 and the extensions that the Khronos glTF validator
/// knows, with its codes, JSON pointers and severities (docs/reference/validation.md). Reads the
/// files that it refers to with `reader`. Lists the first `limit` findings. The cost is
/// proportional to the size of the files.
ValidationResult validate_gltf(std::span<const std::byte> file, ResourceReader& reader,
                               std::size_t limit = kMaxFindings);

}  // namespace tessera::render
