#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

namespace {

void link_view(LinkedDocument& document, std::size_t i) {
  const JsonNode* json = document.buffer_views.get(static_cast<std::int64_t>(i));
  if (json == nullptr) return;
  LinkedView& view = document.views[i];
  const std::string path = document.buffer_views.pointer(i);
  const std::int64_t index = json->integer("buffer");
  const JsonNode* buffer = document.resolve(document.buffers, index, path, "buffer");
  if (buffer == nullptr) return;
  view.buffer = index;
  const std::int64_t bytes = buffer->integer("byteLength");
  if (bytes == -1) return;
  if (view.offset >= bytes) {
    document.findings.add_at(rules::kBufferViewTooLong, path, "byteOffset");
  } else if (view.offset + view.length > bytes) {
    document.findings.add_at(rules::kBufferViewTooLong, path, "byteLength");
  }
}

/// Links one view of a sparse accessor, whose elements are tightly packed.
void link_sparse_view(LinkedDocument& document, const JsonNode& part, std::int64_t component_bytes,
                      std::int64_t length, const std::string& path) {
  const std::int64_t index = part.integer("bufferView");
  if (document.resolve(document.buffer_views, index, path, "bufferView") == nullptr) return;
  document.use_view(index, ViewRole::other, pointer_to(path, "bufferView"));
  const LinkedView& view = document.views[static_cast<std::size_t>(index)];
  if (view.stride != -1) {
    document.findings.add_at(rules::kBufferViewInvalidByteStride, path, "bufferView");
  }
  if (component_bytes == 0) return;
  fits_view(view, part.integer("byteOffset", 0), component_bytes, length, &document.findings, path);
}

void link_sparse(LinkedDocument& document, const LinkedAccessor& accessor, const JsonNode& sparse,
                 const std::string& path) {
  const std::int64_t count = sparse.integer("count");
  if (count > accessor.count) {
    document.findings.add_at(rules::kAccessorSparseCountOutOfRange, path, "count");
  }
  const std::int64_t component = sparse["indices"].integer("componentType");
  const std::int64_t bytes = component == -1     ? 0
                             : component == 5121 ? 1
                             : component == 5123 ? 2
                                                 : 4;
  link_sparse_view(document, sparse["indices"], bytes, bytes * count, pointer_to(path, "indices"));
  link_sparse_view(document, sparse["values"], accessor.component_bytes,
                   accessor.component_bytes * accessor.components * count,
                   pointer_to(path, "values"));
}

void link_accessor(LinkedDocument& document, std::size_t i) {
  const JsonNode* json = document.accessors.get(static_cast<std::int64_t>(i));
  if (json == nullptr) return;
  LinkedAccessor& accessor = document.linked_accessors[i];
  const std::string path = document.accessors.pointer(i);
  const std::int64_t index = json->integer("bufferView");
  if (document.buffer_views.get(index) != nullptr) accessor.view = index;
  if (accessor.count == kNoIndex || accessor.component_bytes == 0 || accessor.format.type.empty()) {
    return;
  }
  if (document.resolve(document.buffer_views, index, path, "bufferView") != nullptr) {
    const LinkedView& view = document.views[static_cast<std::size_t>(index)];
    if (view.stride != -1 && view.stride < accessor.element_bytes()) {
      document.findings.add(rules::kAccessorSmallBytestride, path);
    }
    const std::int64_t stride = view.stride != -1 ? view.stride : accessor.packed_stride();
    fits_view(view, accessor.offset, accessor.component_bytes,
              stride * (accessor.count - 1) + accessor.element_bytes(), &document.findings, path);
  }
  if (accessor.has_sparse) {
    link_sparse(document, accessor, (*json)["sparse"], pointer_to(path, "sparse"));
  }
}

void link_image(LinkedDocument& document, std::size_t i) {
  const JsonNode* json = document.images.get(static_cast<std::int64_t>(i));
  if (json == nullptr) return;
  const std::string path = document.images.pointer(i);
  const std::int64_t view = json->integer("bufferView");
  if (document.resolve(document.buffer_views, view, path, "bufferView") == nullptr) return;
  document.use_view(view, ViewRole::image, pointer_to(path, "bufferView"));
  if (document.views[static_cast<std::size_t>(view)].stride != -1) {
    document.findings.add_at(rules::kImageBufferViewWithBytestride, path, "bufferView");
  }
}

void link_texture(LinkedDocument& document, std::size_t i) {
  const JsonNode* json = document.textures.get(static_cast<std::int64_t>(i));
  if (json == nullptr) return;
  const std::string path = document.textures.pointer(i);
  document.resolve(document.images, json->integer("source"), path, "source");
  document.resolve(document.samplers, json->integer("sampler"), path, "sampler");
  const JsonNode& webp = document.checked.extension(*json, "EXT_texture_webp");
  document.resolve(document.images, webp.integer("source"), path + "/extensions/EXT_texture_webp",
                   "source");
}

}  // namespace

bool fits_view(const LinkedView& view, std::int64_t offset, std::int64_t size, std::int64_t length,
               ValidationFindings* findings, const std::string& path) {
  if (offset == -1) return false;
  bool fits = true;
  if (offset % size != 0) {
    if (findings == nullptr) return false;
    findings->add_at(rules::kAccessorOffsetAlignment, path, "byteOffset");
  }
  if (view.offset == -1) return false;
  if ((view.offset + offset) % size != 0) {
    if (findings == nullptr) return false;
    findings->add(rules::kAccessorTotalOffsetAlignment, path);
  }
  if (offset > view.length) {
    fits = false;
    if (findings != nullptr) findings->add_at(rules::kAccessorTooLong, path, "byteOffset");
  } else if (offset + length > view.length) {
    fits = false;
    if (findings != nullptr) findings->add(rules::kAccessorTooLong, path);
  }
  return fits;
}

void link_views_and_accessors(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.views.size(); ++i) link_view(document, i);
  for (std::size_t i = 0; i < document.linked_accessors.size(); ++i) link_accessor(document, i);
}

void link_images_and_textures(LinkedDocument& document) {
  for (std::size_t i = 0; i < document.images.size(); ++i) link_image(document, i);
  for (std::size_t i = 0; i < document.textures.size(); ++i) link_texture(document, i);
}

}  // namespace tessera::render
