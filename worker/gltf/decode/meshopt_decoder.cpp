#include "worker/gltf/decode/meshopt_decoder.h"

#include <meshoptimizer.h>

#include "absl/strings/str_cat.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {

namespace {

absl::Status check_layout(const MeshoptLayout& layout) {
  const bool attributes = layout.mode == "ATTRIBUTES";
  const bool triangles = layout.mode == "TRIANGLES";
  const bool filtered = !layout.filter.empty() && layout.filter != "NONE";
  if (!attributes && !triangles && layout.mode != "INDICES") {
    return absl::InvalidArgumentError(absl::StrCat("unknown mode ", std::string(layout.mode)));
  }
  if (layout.count == 0 || layout.count > kMaxDecodedBytes / 256) {
    return absl::InvalidArgumentError(absl::StrCat("count ", layout.count, " is out of range"));
  }
  if (attributes && (layout.stride == 0 || layout.stride > 256 || layout.stride % 4 != 0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("byteStride ", layout.stride, " is not a multiple of 4 up to 256"));
  }
  if (!attributes && (filtered || (layout.stride != 2 && layout.stride != 4))) {
    return absl::InvalidArgumentError("indices require a byteStride of 2 or 4 and no filter");
  }
  if (triangles && layout.count % 3 != 0) {
    return absl::InvalidArgumentError(absl::StrCat("count ", layout.count, " of triangle indices"));
  }
  const bool octahedral = layout.filter == "OCTAHEDRAL", quaternion = layout.filter == "QUATERNION";
  if (filtered && !octahedral && !quaternion && layout.filter != "EXPONENTIAL") {
    return absl::InvalidArgumentError(absl::StrCat("unknown filter ", std::string(layout.filter)));
  }
  if ((octahedral && layout.stride != 4 && layout.stride != 8) ||
      (quaternion && layout.stride != 8)) {
    return absl::InvalidArgumentError(
        absl::StrCat("byteStride ", layout.stride, " does not fit the filter"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<std::byte>> decode_meshopt(std::span<const std::byte> encoded,
                                                      const MeshoptLayout& layout) {
  absl::Status valid = check_layout(layout);
  if (!valid.ok()) return valid;
  // 16 vertices take at least one bit per byte group, indices one byte per triangle. A much
  // shorter stream is a decompression bomb and is rejected before its output is allocated.
  const std::size_t min_size =
      layout.mode == "ATTRIBUTES" ? layout.count * layout.stride / 256 / 4 : layout.count / 3;
  if (encoded.size() < min_size) {
    return absl::InvalidArgumentError(
        absl::StrCat(encoded.size(), " bytes cannot hold ", layout.count, " elements: truncated?"));
  }
  std::vector<std::byte> out(layout.count * layout.stride);
  const auto* in = reinterpret_cast<const unsigned char*>(encoded.data());
  int error = 0;
  if (layout.mode == "ATTRIBUTES") {
    error = meshopt_decodeVertexBuffer(out.data(), layout.count, layout.stride, in, encoded.size());
  } else if (layout.mode == "TRIANGLES") {
    error = meshopt_decodeIndexBuffer(out.data(), layout.count, layout.stride, in, encoded.size());
  } else {
    error =
        meshopt_decodeIndexSequence(out.data(), layout.count, layout.stride, in, encoded.size());
  }
  if (error != 0) {
    return absl::InvalidArgumentError(absl::StrCat("the meshopt stream is damaged (", error, ")"));
  }
  if (layout.filter == "OCTAHEDRAL") {
    meshopt_decodeFilterOct(out.data(), layout.count, layout.stride);
  } else if (layout.filter == "QUATERNION") {
    meshopt_decodeFilterQuat(out.data(), layout.count, layout.stride);
  } else if (layout.filter == "EXPONENTIAL") {
    meshopt_decodeFilterExp(out.data(), layout.count, layout.stride);
  }
  return out;
}

}  // namespace tessera::render
