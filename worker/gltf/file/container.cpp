#include "worker/gltf/file/container.h"

#include <cstdint>
#include <string>

#include "absl/strings/str_cat.h"
#include "worker/gltf/file/glb_layout.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {

namespace {

std::string_view as_text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

absl::Status check_json(std::string_view json) {
  if (json.size() > kMaxJsonBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("JSON: ", json.size(), " bytes, more than the limit of ", kMaxJsonBytes));
  }
  if (json_depth(json) > kMaxJsonDepth) {
    return absl::InvalidArgumentError(
        absl::StrCat("JSON: nested deeper than ", kMaxJsonDepth, " levels"));
  }
  return absl::OkStatus();
}

absl::StatusOr<GltfContainer> split_glb(std::span<const std::byte> file) {
  if (file.size() < glb::kHeaderBytes + glb::kChunkHeaderBytes) {
    return absl::InvalidArgumentError("GLB header: the file is truncated");
  }
  const std::uint32_t version = glb::read_u32(file, 4);
  if (version != 2) {
    return absl::InvalidArgumentError(
        absl::StrCat("GLB header: version ", version, ", expected 2"));
  }
  const std::uint32_t length = glb::read_u32(file, 8);
  if (length > file.size() || length < glb::kHeaderBytes + glb::kChunkHeaderBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("GLB header: length ", length, ", but the file has ", file.size(), " bytes"));
  }
  GltfContainer parts;
  std::size_t at = glb::kHeaderBytes;
  for (int chunk = 0; at + glb::kChunkHeaderBytes <= length; ++chunk) {
    const std::uint32_t size = glb::read_u32(file, at);
    const std::uint32_t type = glb::read_u32(file, at + 4);
    at += glb::kChunkHeaderBytes;
    if (size > length - at) {
      return absl::InvalidArgumentError(absl::StrCat("GLB chunk ", chunk, ": ", size,
                                                     " bytes, but only ", length - at,
                                                     " remain in the file"));
    }
    const auto body = file.subspan(at, size);
    if (chunk == 0 && type != glb::kJsonChunk) {
      return absl::InvalidArgumentError("GLB chunk 0: not a JSON chunk");
    }
    if (chunk == 0) parts.json = as_text(body);
    if (chunk == 1 && type == glb::kBinChunk) {
      parts.bin = body;
      parts.has_bin = true;
    }
    at += size;
  }
  return parts;
}

}  // namespace

int json_depth(std::string_view json) {
  int depth = 0, deepest = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < json.size() && deepest <= kMaxJsonDepth; ++i) {
    const char c = json[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
    } else if (c == '"') {
      in_string = true;
    } else if (c == '[' || c == '{') {
      deepest = ++depth > deepest ? depth : deepest;
    } else if (c == ']' || c == '}') {
      --depth;
    }
  }
  return deepest;
}

absl::StatusOr<GltfContainer> split_container(std::span<const std::byte> file) {
  GltfContainer parts;
  if (file.size() >= 4 && glb::read_u32(file, 0) == glb::kMagic) {
    auto glb = split_glb(file);
    if (!glb.ok()) return glb.status();
    parts = *glb;
  } else {
    parts.json = as_text(file);
    if (parts.json.substr(0, 3) == "\xEF\xBB\xBF") parts.json.remove_prefix(3);
    const std::size_t first = parts.json.find_first_not_of(" \t\r\n");
    if (first == std::string_view::npos || parts.json[first] != '{') {
      return absl::InvalidArgumentError(
          "file: neither glTF JSON (it does not begin with '{') nor GLB (no 'glTF' magic)");
    }
  }
  absl::Status valid = check_json(parts.json);
  if (!valid.ok()) return valid;
  return parts;
}

}  // namespace tessera::render
