#pragma once

#include <string>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Reads the core glTF model in `text` (see core_text()) with tinygltf and fills in the document,
/// checking every index, the node hierarchy and the values of enumerations. The only file that
/// knows tinygltf. Errors: InvalidArgument "ELEMENT: FAULT".
absl::Status read_core_model(const std::string& text, GltfModel& document);

}  // namespace tessera::render
