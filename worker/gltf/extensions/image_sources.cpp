#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/file/json_view.h"
#include "worker/gltf/file/uri.h"

namespace tessera::render {

namespace {

void report(const JsonView& where, const absl::Status& status, JsonFault& fault) {
  fault.report(where.path(), std::string(status.message()));
}

/// Reads an image: decodes data URIs and resolves views; files are only named here and read later
/// if a material needs them.
GltfImage read_image(const JsonView& image, GltfModel& model, JsonFault& fault) {
  GltfImage out;
  out.name = image.path();
  const std::string uri = image.text("uri");
  const std::int32_t view = image.index("bufferView", model.views.size());
  if (!uri.empty() && view != kNone) fault.report(image.path(), "has both uri and bufferView");
  if (is_data_uri(uri)) {
    auto data = decode_data_uri(uri);
    if (!data.ok()) {
      report(image, data.status(), fault);
      return out;
    }
    model.owned.push_back(*std::move(data));
    out.bytes = model.owned.back();
  } else if (!uri.empty()) {
    const auto path = relative_path(uri);
    if (path.ok()) {
      out.uri = out.name = *path;
    } else {
      report(image, path.status(), fault);
    }
  } else if (view != kNone) {
    const BufferView& v = model.views[view];
    if (const absl::Status* cause = model.faults.find("bufferViews", view)) {
      model.faults.add(image.path(), *cause);
      return out;
    }
    out.bytes = model.buffers[v.buffer].subspan(v.offset, v.length);
  } else {
    fault.report(image.path(), "has neither uri nor bufferView");
  }
  return out;
}

GltfTexture read_texture(const JsonView& texture, const GltfModel& model) {
  GltfTexture out;
  out.sampler = texture.index("sampler", model.samplers.size());
  const std::size_t images = model.images.size();
  const std::int32_t plain = texture.index("source", images);
  const std::int32_t webp = texture.extension("EXT_texture_webp").index("source", images);
  const std::int32_t basisu = texture.extension("KHR_texture_basisu").index("source", images);
  out.image = webp != kNone ? webp : plain;
  out.basisu_only = out.image == kNone && basisu != kNone;
  return out;
}

}  // namespace

absl::Status read_images(const nlohmann::json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  const JsonView view(root, "", fault);
  for (const JsonView& image : view["images"].items()) {
    model.images.push_back(read_image(image, model, fault));
  }
  for (const JsonView& texture : view["textures"].items()) {
    model.texture_sources.push_back(read_texture(texture, model));
  }
  return fault.status();
}

}  // namespace tessera::render
