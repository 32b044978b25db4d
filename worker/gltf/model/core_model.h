#pragma once

#include <string>

#include "absl/status/status.h"
#include "worker/gltf/model/gltf_model.h"

namespace tessera::render {

/// Reads the core glTF model in `text` (see core_text()) with tinygltf into `model` and checks
/// every index, the node hierarchy and the values of enumerations. No other file includes tinygltf.
/// Errors: InvalidArgument "ELEMENT: FAULT".
absl::Status read_core_model(const std::string& text, GltfModel& model);

}  // namespace tessera::render
