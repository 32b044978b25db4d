#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "worker/gltf/file/resource_reader.h"
#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

/// Bytes of data URIs, which a document's views refer to.
using DecodedUris = std::vector<std::vector<std::byte>>;

/// Reads the buffers of a document and checks their lengths. `binary` is the binary chunk of a GLB;
/// null if it has none.
void load_buffers(LinkedDocument& document, const std::span<const std::byte>* binary,
                  ResourceReader& reader, DecodedUris& decoded);

/// Reads the headers of the images and checks them, then the types of the textures' images.
void check_images(LinkedDocument& document, ResourceReader& reader);

}  // namespace tessera::render
