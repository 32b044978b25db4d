#include "worker/gltf/validate/links/resources.h"

#include <algorithm>
#include <optional>

#include "absl/status/statusor.h"
#include "worker/gltf/file/uri.h"
#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/formats/uri_rules.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;
using Bytes = std::span<const std::byte>;

/// Reads the file that a URI names; a finding at `path` if that fails.
std::optional<Bytes> read_file(LinkedDocument& document, const std::string& uri,
                               const std::string& path, ResourceReader& reader) {
  const auto relative = relative_path(uri);
  const auto bytes = relative.ok() ? reader.read(*relative) : relative.status();
  if (bytes.ok()) return *bytes;
  document.findings.add_at(rules::kIoError, path, "uri", std::string(bytes.status().message()));
  return std::nullopt;
}

void load_buffer(LinkedDocument& document, std::size_t i, const Bytes* binary,
                 ResourceReader& reader, DecodedUris& decoded) {
  const JsonNode* json = document.buffers.get(static_cast<std::int64_t>(i));
  if (json == nullptr || json->integer("byteLength") == -1) return;
  const std::string path = document.buffers.pointer(i);
  const std::string& uri = json->text_of("uri");
  BufferBytes& out = document.buffer_bytes[i];
  if (is_valid_data_uri(uri)) {
    const std::string type = media_type_of(uri);
    if (type != "application/gltf-buffer" && type != "application/octet-stream") return;
    decoded.push_back(*decode_data_uri(uri));
    out = {true, decoded.back()};
  } else if ((*json)["uri"].is(Kind::text)) {
    if (form_of_uri(uri) == UriForm::invalid) return;
    const auto bytes = read_file(document, uri, path, reader);
    if (bytes) out = {true, *bytes};
  } else if (document.checked.is_glb && i == 0 && !json->has("uri")) {
    if (binary == nullptr) {
      document.findings.add(rules::kBufferMissingGlbData, path);
      return;
    }
    out = {true, *binary};
  }
  if (!out.present) return;
  const std::uint64_t size = out.bytes.size();
  const auto length = static_cast<std::uint64_t>(json->integer("byteLength"));
  if (size < length) {
    document.findings.add(rules::kBufferByteLengthMismatch, path,
                          std::to_string(size) + " bytes, expected " + std::to_string(length));
    if (!is_valid_data_uri(uri)) out = {};
  } else if (document.checked.is_glb && i == 0 && !json->has("uri") &&
             size > (length + 3) / 4 * 4) {
    document.findings.add(rules::kBufferGlbChunkTooBig, path);
  }
}

/// Bytes of a view, as far as they exist.
std::optional<Bytes> bytes_of_view(const LinkedDocument& document, std::int64_t index) {
  const LinkedView& view = document.views[static_cast<std::size_t>(index)];
  if (view.buffer == kNoIndex || view.offset < 0 || view.length < 0) return std::nullopt;
  const BufferBytes& buffer = document.buffer_bytes[static_cast<std::size_t>(view.buffer)];
  const auto offset = static_cast<std::uint64_t>(view.offset);
  const auto length = static_cast<std::uint64_t>(view.length);
  if (!buffer.present || offset > buffer.bytes.size() || length > buffer.bytes.size() - offset) {
    return std::nullopt;
  }
  return buffer.bytes.subspan(offset, length);
}

/// Reports what the header of an image says. Returns whether it could be read.
bool report_header(LinkedDocument& document, const ImageHeader& header, const std::string& path) {
  if (header.state == ImageHeader::State::unrecognised) {
    document.findings.add(rules::kImageUnrecognizedFormat, path);
    return false;
  }
  if (header.state == ImageHeader::State::truncated) {
    document.findings.add(rules::kImageUnexpectedEos, path);
    return false;
  }
  if (header.state == ImageHeader::State::damaged) {
    document.findings.add(rules::kImageDataInvalid, path);
    return false;
  }
  const auto is_power_of_two = [](std::uint32_t n) { return n != 0 && (n & (n - 1)) == 0; };
  if (!is_power_of_two(header.width) || !is_power_of_two(header.height)) {
    document.findings.add(rules::kImageNpotDimensions, path,
                          std::to_string(header.width) + "x" + std::to_string(header.height));
  }
  if (header.has_ignored_features) document.findings.add(rules::kImageFeaturesUnsupported, path);
  return true;
}

void check_image(LinkedDocument& document, std::size_t i, ResourceReader& reader) {
  const JsonNode* json = document.images.get(static_cast<std::int64_t>(i));
  if (json == nullptr || (*json)["extensions"].size() != 0) return;
  const std::string path = document.images.pointer(i);
  const std::string& uri = json->text_of("uri");
  const std::int64_t view = json->integer("bufferView");
  std::optional<std::vector<std::byte>> owned;
  std::optional<Bytes> bytes;
  if (is_valid_data_uri(uri)) {
    owned = image_data_of(uri);
    if (owned) bytes = *owned;
  } else if ((*json)["uri"].is(Kind::text)) {
    if (form_of_uri(uri) != UriForm::invalid) bytes = read_file(document, uri, path, reader);
  } else if (document.buffer_views.get(view) != nullptr) {
    bytes = bytes_of_view(document, view);
  }
  if (!bytes) return;
  const ImageHeader header = read_image_header(*bytes);
  if (!report_header(document, header, path)) return;
  document.image_types[i] = header.media_type;
  const bool is_enabled =
      header.media_type != "image/webp" || document.checked.enabled.count("EXT_texture_webp") != 0;
  if (!is_enabled) document.findings.add(rules::kImageNonEnabledMimeType, path);
  const JsonNode& declared = (*json)["mimeType"];
  if (declared.is(Kind::text) && declared.text() != header.media_type) {
    const bool from_view = !(*json)["uri"].is(Kind::text);
    document.findings.add_at(rules::kImageMimeTypeInvalid, path, from_view ? "bufferView" : "uri",
                             header.media_type);
  }
}

/// Reports a texture whose image has none of the allowed types.
void check_texture_image(LinkedDocument& document, std::int64_t image,
                         std::initializer_list<std::string_view> allowed, const std::string& path) {
  const JsonNode* json = document.images.get(image);
  if (json == nullptr) return;
  const JsonNode& declared = (*json)["mimeType"];
  const std::string_view type = declared.is(Kind::text)
                                    ? std::string_view(declared.text())
                                    : document.image_types[static_cast<std::size_t>(image)];
  const bool known = declared.is(Kind::text) || !type.empty();
  if (known && std::find(allowed.begin(), allowed.end(), type) == allowed.end()) {
    document.findings.add_at(rules::kTextureInvalidImageMimeType, path, "source", type);
  }
}

}  // namespace

void load_buffers(LinkedDocument& document, const Bytes* binary, ResourceReader& reader,
                  DecodedUris& decoded) {
  for (std::size_t i = 0; i < document.buffers.size(); ++i) {
    load_buffer(document, i, binary, reader, decoded);
  }
}

void check_images(LinkedDocument& document, ResourceReader& reader) {
  for (std::size_t i = 0; i < document.images.size(); ++i) check_image(document, i, reader);
  for (std::size_t i = 0; i < document.textures.size(); ++i) {
    const JsonNode* json = document.textures.get(static_cast<std::int64_t>(i));
    if (json == nullptr) continue;
    const std::string path = document.textures.pointer(i);
    check_texture_image(document, json->integer("source"), {"image/jpeg", "image/png"}, path);
    const JsonNode& webp = document.checked.extension(*json, "EXT_texture_webp");
    check_texture_image(document, webp.integer("source"), {"image/webp"},
                        path + "/extensions/EXT_texture_webp");
  }
}

}  // namespace tessera::render
