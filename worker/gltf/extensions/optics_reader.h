#pragma once

#include "worker/gltf/file/json_view.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// TESSERA_material (docs/extensions.md); nothing of an absent one. Faults go to `fault`.
Optics read_optics(const JsonView& look, JsonFault& fault);

}  // namespace tessera::render
