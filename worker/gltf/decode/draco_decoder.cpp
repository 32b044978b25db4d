#include "worker/gltf/decode/draco_decoder.h"

#include <cstring>
#include <exception>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include <draco/compression/decode.h>
#pragma GCC diagnostic pop

#include "absl/strings/str_cat.h"

namespace tessera::render {

struct DracoGeometry::Parts {
  std::unique_ptr<draco::Mesh> mesh;
};

namespace {

template <typename T>
bool convert(const draco::PointAttribute& attribute, std::size_t points, int components,
             std::vector<std::byte>& out) {
  out.resize(points * components * sizeof(T));
  std::vector<T> element(static_cast<std::size_t>(components));
  for (std::size_t i = 0; i < points; ++i) {
    const auto point = draco::PointIndex(static_cast<std::uint32_t>(i));
    const auto index = attribute.mapped_index(point);
    if (index.value() >= attribute.size()) return false;
    if (!attribute.ConvertValue<T>(index, static_cast<std::int8_t>(components), element.data())) {
      return false;
    }
    std::memcpy(out.data() + i * components * sizeof(T), element.data(), components * sizeof(T));
  }
  return true;
}

bool convert_as(ComponentType type, const draco::PointAttribute& attribute, std::size_t points,
                int components, std::vector<std::byte>& out) {
  switch (type) {
    case ComponentType::i8:
      return convert<std::int8_t>(attribute, points, components, out);
    case ComponentType::u8:
      return convert<std::uint8_t>(attribute, points, components, out);
    case ComponentType::i16:
      return convert<std::int16_t>(attribute, points, components, out);
    case ComponentType::u16:
      return convert<std::uint16_t>(attribute, points, components, out);
    case ComponentType::u32:
      return convert<std::uint32_t>(attribute, points, components, out);
    case ComponentType::f32:
      return convert<float>(attribute, points, components, out);
  }
  return false;
}

}  // namespace

DracoGeometry::DracoGeometry(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
DracoGeometry::~DracoGeometry() = default;

absl::StatusOr<std::unique_ptr<DracoGeometry>> DracoGeometry::decode(
    std::span<const std::byte> stream) {
  try {
    draco::DecoderBuffer buffer;
    buffer.Init(reinterpret_cast<const char*>(stream.data()), stream.size());
    draco::Decoder decoder;
    auto decoded = decoder.DecodeMeshFromBuffer(&buffer);
    if (!decoded.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat("the Draco stream is damaged: ", decoded.status().error_msg_string()));
    }
    auto parts = std::make_unique<Parts>();
    parts->mesh = std::move(decoded).value();
    if (parts->mesh == nullptr) return absl::InvalidArgumentError("the Draco stream has no mesh");
    return std::unique_ptr<DracoGeometry>(new DracoGeometry(std::move(parts)));
  } catch (const std::exception& e) {  // bad_alloc or length_error from invalid counts
    return absl::InvalidArgumentError(absl::StrCat("the Draco stream is damaged: ", e.what()));
  }
}

std::size_t DracoGeometry::points() const {
  return parts_->mesh->num_points();
}
std::size_t DracoGeometry::triangles() const {
  return parts_->mesh->num_faces();
}

absl::StatusOr<std::vector<std::byte>> DracoGeometry::indices() const {
  std::vector<std::byte> out(triangles() * 3 * sizeof(std::uint32_t));
  for (std::size_t i = 0; i < triangles(); ++i) {
    const auto face = parts_->mesh->face(draco::FaceIndex(static_cast<std::uint32_t>(i)));
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t index = face[k].value();
      if (index >= points()) {
        return absl::InvalidArgumentError(
            absl::StrCat("the Draco mesh has index ", index, " of ", points(), " points"));
      }
      std::memcpy(out.data() + (3 * i + k) * sizeof index, &index, sizeof index);
    }
  }
  return out;
}

absl::StatusOr<std::vector<std::byte>> DracoGeometry::attribute(std::int64_t id, ComponentType type,
                                                                int components) const {
  const draco::PointAttribute* attribute =
      parts_->mesh->GetAttributeByUniqueId(static_cast<std::uint32_t>(id));
  if (attribute == nullptr) {
    return absl::InvalidArgumentError(absl::StrCat("the Draco mesh has no attribute ", id));
  }
  if (attribute->num_components() != components) {
    return absl::InvalidArgumentError(absl::StrCat("Draco attribute ", id, " has ",
                                                   static_cast<int>(attribute->num_components()),
                                                   " components, expected ", components));
  }
  if (!attribute->is_mapping_identity() && attribute->indices_map_size() < points()) {
    return absl::InvalidArgumentError(
        absl::StrCat("Draco attribute ", id, " does not cover all points"));
  }
  std::vector<std::byte> out;
  if (!convert_as(type, *attribute, points(), components, out)) {
    return absl::InvalidArgumentError(
        absl::StrCat("Draco attribute ", id, " does not fit its accessor's component type"));
  }
  return out;
}

}  // namespace tessera::render
