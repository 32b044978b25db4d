#include "worker/gltf/decode/accessor_reader.h"

#include <algorithm>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {

namespace {

constexpr std::size_t kMaxStride = 252;

std::string element(std::int32_t index) {
  return absl::StrCat("accessors[", index, "]");
}

absl::Status fault(std::int32_t index, const std::string& message) {
  return absl::InvalidArgumentError(absl::StrCat(element(index), ": ", message));
}

/// Location of an array of elements in a view.
struct Range {
  std::int32_t view = kNone;
  std::size_t offset = 0, element_bytes = 0, stride = 0, count = 0;
};

/// Stride between columns of a matrix, bytes; columns are aligned to 4.
std::size_t column_bytes(const Accessor& a) {
  const std::size_t bytes = static_cast<std::size_t>(component_bytes(a.type)) * a.rows;
  return a.columns > 1 ? (bytes + 3) / 4 * 4 : bytes;
}

std::size_t element_bytes(const Accessor& a) {
  return column_bytes(a) * a.columns;
}

std::size_t view_stride(const GltfModel& model, const Accessor& a) {
  const std::size_t stride = a.view == kNone ? 0 : model.views[a.view].stride;
  return stride != 0 ? stride : element_bytes(a);
}

/// Checks that the range lies within its view. Counts and strides are bounded, so nothing
/// overflows.
absl::Status check_range(const GltfModel& model, std::int32_t index, const Range& r) {
  if (r.view < 0 || static_cast<std::size_t>(r.view) >= model.views.size()) {
    return fault(index, absl::StrCat("bufferViews[", r.view, "] does not exist"));
  }
  const BufferView& view = model.views[r.view];
  if (r.count == 0) return absl::OkStatus();
  const auto need = static_cast<std::uint64_t>(r.count - 1) * r.stride + r.element_bytes;
  if (r.offset > view.length || need > view.length - r.offset) {
    return fault(index, absl::StrCat("count ", r.count, " at offset ", r.offset, " exceeds the ",
                                     view.length, " bytes of bufferViews[", r.view, "]"));
  }
  return absl::OkStatus();
}

absl::Status check_sparse(const GltfModel& model, std::int32_t index) {
  const Accessor& a = model.accessors[index];
  const SparseValues& s = *a.sparse;
  if (s.count < 1 || s.count > a.count) {
    return fault(index, absl::StrCat("sparse.count ", s.count, " is not in 1..", a.count));
  }
  if (s.index_type != ComponentType::u8 && s.index_type != ComponentType::u16 &&
      s.index_type != ComponentType::u32) {
    return fault(index, "sparse.indices.componentType is not an unsigned integer");
  }
  const auto count = static_cast<std::size_t>(s.count);
  const auto index_bytes = static_cast<std::size_t>(component_bytes(s.index_type));
  absl::Status indices =
      check_range(model, index, {s.index_view, s.index_offset, index_bytes, index_bytes, count});
  if (!indices.ok()) return indices;
  return check_range(model, index,
                     {s.value_view, s.value_offset, element_bytes(a), element_bytes(a), count});
}

/// First byte of a view's contents. Requires check_range().
const std::byte* view_bytes(const GltfModel& model, std::int32_t view) {
  return model.buffers[model.views[view].buffer].data() + model.views[view].offset;
}

template <typename T>
T read_as(const std::byte* at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

/// One component as a float. Normalised: glTF 2.0, section 3.6.2.2 ("Accessor Data Types").
float read_component(const std::byte* at, ComponentType type, bool normalized) {
  switch (type) {
    case ComponentType::i8: {
      const auto v = static_cast<float>(read_as<std::int8_t>(at));
      if (!normalized) return v;
      return v / 127.0f < -1.0f ? -1.0f : v / 127.0f;
    }
    case ComponentType::u8: {
      const auto v = static_cast<float>(read_as<std::uint8_t>(at));
      return normalized ? v / 255.0f : v;
    }
    case ComponentType::i16: {
      const auto v = static_cast<float>(read_as<std::int16_t>(at));
      if (!normalized) return v;
      return v / 32767.0f < -1.0f ? -1.0f : v / 32767.0f;
    }
    case ComponentType::u16: {
      const auto v = static_cast<float>(read_as<std::uint16_t>(at));
      return normalized ? v / 65535.0f : v;
    }
    case ComponentType::u32: {
      const auto v = static_cast<double>(read_as<std::uint32_t>(at));
      return static_cast<float>(normalized ? v / 4294967295.0 : v);
    }
    case ComponentType::f32:
      return read_as<float>(at);
  }
  return 0;
}

std::uint32_t read_unsigned(const std::byte* at, ComponentType type) {
  if (type == ComponentType::u8) return read_as<std::uint8_t>(at);
  if (type == ComponentType::u16) return read_as<std::uint16_t>(at);
  return read_as<std::uint32_t>(at);
}

/// Indices of the elements that a sparse accessor replaces, strictly increasing and in range.
absl::StatusOr<std::vector<std::uint32_t>> sparse_indices(const GltfModel& model,
                                                          std::int32_t index) {
  const SparseValues& s = *model.accessors[index].sparse;
  const std::byte* from = view_bytes(model, s.index_view) + s.index_offset;
  std::vector<std::uint32_t> out(static_cast<std::size_t>(s.count));
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = read_unsigned(from + i * component_bytes(s.index_type), s.index_type);
    if (out[i] >= model.accessors[index].count) {
      return fault(index, absl::StrCat("sparse index ", out[i], " is not below the count ",
                                       model.accessors[index].count));
    }
    if (i > 0 && out[i] <= out[i - 1]) {
      return fault(index, absl::StrCat("sparse indices do not increase at ", i));
    }
  }
  return out;
}

void read_element(const std::byte* from, const Accessor& a, float* to) {
  const std::size_t column = column_bytes(a);
  const auto component = static_cast<std::size_t>(component_bytes(a.type));
  for (int c = 0; c < a.columns; ++c) {
    for (int r = 0; r < a.rows; ++r) {
      *to++ = read_component(from + c * column + r * component, a.type, a.normalized);
    }
  }
}

/// First fault of the views of an accessor; nullptr if they have none.
const absl::Status* view_fault(const GltfModel& model, const Accessor& a) {
  const std::int32_t sparse[] = {a.sparse ? a.sparse->index_view : kNone,
                                 a.sparse ? a.sparse->value_view : kNone};
  for (const std::int32_t view : {a.view, sparse[0], sparse[1]}) {
    const absl::Status* fault = model.faults.find("bufferViews", view);
    if (fault != nullptr) return fault;
  }
  return nullptr;
}

std::uint64_t buffer_bytes(const GltfModel& model) {
  std::uint64_t bytes = 0;
  for (const auto& buffer : model.buffers) bytes += buffer.size();
  return bytes;
}

/// Checks the decoded size of an accessor. Elements are decoded to floats, whatever the file
/// stores.
absl::Status check_decoded_size(const GltfModel& model, std::int32_t index, std::uint64_t stored) {
  const Accessor& a = model.accessors[index];
  const auto element = 4 * static_cast<std::uint64_t>(a.components());
  const auto count = static_cast<std::uint64_t>(a.count);
  if (a.view != kNone) {
    if (count <= kMaxDecodedBytes / element) return absl::OkStatus();
    return fault(index, absl::StrCat("count ", count, " decodes to more than the limit of ",
                                     kMaxDecodedBytes, " bytes"));
  }
  const std::uint64_t limit = std::min(kMinZeroLimit + 16 * stored, kMaxZeroLimit);
  if (count <= limit / element) return absl::OkStatus();
  return fault(index, absl::StrCat("count ", count, " without a bufferView decodes to more than ",
                                   limit, " bytes, the limit for ", stored,
                                   " bytes of buffers; store its values in a bufferView"));
}

absl::Status check_view(const GltfModel& model, const BufferView& v, const std::string& where) {
  const auto fail = [&](const std::string& message) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": ", message));
  };
  if (v.buffer < 0 || static_cast<std::size_t>(v.buffer) >= model.buffers.size()) {
    return fail(absl::StrCat("buffers[", v.buffer, "] does not exist"));
  }
  const std::size_t size = model.buffers[v.buffer].size();
  if (v.offset > size || v.length > size - v.offset) {
    return fail(absl::StrCat(v.length, " bytes at offset ", v.offset, " exceed the ", size,
                             " bytes of buffers[", v.buffer, "]"));
  }
  if (v.stride > kMaxStride) {
    return fail(absl::StrCat("byteStride ", v.stride, " is above ", kMaxStride));
  }
  return absl::OkStatus();
}

}  // namespace

int component_bytes(ComponentType type) {
  switch (type) {
    case ComponentType::i8:
    case ComponentType::u8:
      return 1;
    case ComponentType::i16:
    case ComponentType::u16:
      return 2;
    case ComponentType::u32:
    case ComponentType::f32:
      return 4;
  }
  return 4;
}

void check_views(GltfModel& model) {
  for (std::size_t i = 0; i < model.views.size(); ++i) {
    BufferView& view = model.views[i];
    const std::string where = absl::StrCat("bufferViews[", i, "]");
    const absl::Status* cause = model.faults.find("buffers", view.buffer);
    const absl::Status status = cause != nullptr ? *cause : check_view(model, view, where);
    if (!status.ok()) model.faults.add(where, status);
    if (model.faults.find("bufferViews", static_cast<std::int32_t>(i)) != nullptr)
      view.offset = view.length = 0;
  }
}

absl::Status check_accessor(const GltfModel& model, std::int32_t index, std::uint64_t stored) {
  const Accessor& a = model.accessors[index];
  if (a.count < 1) return fault(index, absl::StrCat("count ", a.count, " is below 1"));
  const std::size_t bytes = element_bytes(a);
  absl::Status size = check_decoded_size(model, index, stored);
  if (!size.ok()) return size;
  if (a.view != kNone) {
    const std::size_t stride =
        static_cast<std::size_t>(a.view) < model.views.size() ? view_stride(model, a) : bytes;
    if (stride < bytes) {
      return fault(
          index, absl::StrCat("byteStride ", stride, " is below the element's ", bytes, " bytes"));
    }
    absl::Status range = check_range(
        model, index, {a.view, a.offset, bytes, stride, static_cast<std::size_t>(a.count)});
    if (!range.ok()) return range;
  }
  return a.sparse ? check_sparse(model, index) : absl::OkStatus();
}

std::uint64_t decoded_bytes(const GltfModel& model, std::int32_t index) {
  const Accessor& a = model.accessors[index];
  return static_cast<std::uint64_t>(a.count) * static_cast<std::uint64_t>(a.components()) * 4;
}

absl::Status check_accessors(GltfModel& model) {
  const std::uint64_t stored = buffer_bytes(model), limit = kMaxAccessorBytes + 16 * stored;
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < model.accessors.size(); ++i) {
    const auto index = static_cast<std::int32_t>(i);
    const absl::Status* cause = view_fault(model, model.accessors[i]);
    const absl::Status status = cause != nullptr ? *cause : check_accessor(model, index, stored);
    if (!status.ok()) model.faults.add(absl::StrCat("accessors[", i, "]"), status);
    if (model.faults.find("accessors", index) != nullptr) {
      model.accessors[i].count = 1;
      model.accessors[i].view = kNone;
      model.accessors[i].sparse.reset();
    }
    total += decoded_bytes(model, index);
    if (total > limit) {
      return absl::InvalidArgumentError(absl::StrCat("accessors: the first ", i + 1, " decode to ",
                                                     total, " bytes, more than the limit of ",
                                                     limit, " for this file"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<float>> read_floats(const GltfModel& model, std::int32_t index,
                                               int components) {
  const Accessor& a = model.accessors[index];
  if (a.components() != components) {
    return fault(index, absl::StrCat("has ", a.components(), " components, expected ", components));
  }
  const auto count = static_cast<std::size_t>(a.count);
  std::vector<float> out(count * components);
  if (a.view != kNone) {
    const std::byte* from = view_bytes(model, a.view) + a.offset;
    const std::size_t stride = view_stride(model, a);
    if (a.type == ComponentType::f32 && stride == sizeof(float) * components) {
      std::memcpy(out.data(), from, out.size() * sizeof(float));
    } else {
      for (std::size_t i = 0; i < count; ++i) {
        read_element(from + i * stride, a, out.data() + i * components);
      }
    }
  }
  if (a.sparse) {
    const auto places = sparse_indices(model, index);
    if (!places.ok()) return places.status();
    const std::byte* from = view_bytes(model, a.sparse->value_view) + a.sparse->value_offset;
    for (std::size_t i = 0; i < places->size(); ++i) {
      read_element(from + i * element_bytes(a), a,
                   out.data() + static_cast<std::size_t>((*places)[i]) * components);
    }
  }
  return out;
}

absl::StatusOr<std::vector<std::uint32_t>> read_indices(const GltfModel& model,
                                                        std::int32_t index) {
  const Accessor& a = model.accessors[index];
  if (a.components() != 1 || a.normalized ||
      (a.type != ComponentType::u8 && a.type != ComponentType::u16 &&
       a.type != ComponentType::u32)) {
    return fault(index, "indices must be scalars of an unsigned integer type");
  }
  std::vector<std::uint32_t> out(static_cast<std::size_t>(a.count));
  if (a.view != kNone) {
    const std::byte* from = view_bytes(model, a.view) + a.offset;
    const std::size_t stride = view_stride(model, a);
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = read_unsigned(from + i * stride, a.type);
  }
  if (a.sparse) {
    const auto places = sparse_indices(model, index);
    if (!places.ok()) return places.status();
    const std::byte* from = view_bytes(model, a.sparse->value_view) + a.sparse->value_offset;
    for (std::size_t i = 0; i < places->size(); ++i) {
      out[(*places)[i]] = read_unsigned(from + i * element_bytes(a), a.type);
    }
  }
  return out;
}

absl::StatusOr<std::vector<Vec2f>> read_vec2(const GltfModel& model, std::int32_t index) {
  const auto floats = read_floats(model, index, 2);
  if (!floats.ok()) return floats.status();
  std::vector<Vec2f> out(floats->size() / 2);
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = {(*floats)[2 * i], (*floats)[2 * i + 1]};
  return out;
}

absl::StatusOr<std::vector<Vec3f>> read_vec3(const GltfModel& model, std::int32_t index) {
  const auto floats = read_floats(model, index, 3);
  if (!floats.ok()) return floats.status();
  std::vector<Vec3f> out(floats->size() / 3);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float* f = floats->data() + 3 * i;
    out[i] = {f[0], f[1], f[2]};
  }
  return out;
}

absl::StatusOr<std::vector<Vec4f>> read_vec4(const GltfModel& model, std::int32_t index) {
  const auto floats = read_floats(model, index, 4);
  if (!floats.ok()) return floats.status();
  std::vector<Vec4f> out(floats->size() / 4);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const float* f = floats->data() + 4 * i;
    out[i] = {f[0], f[1], f[2], f[3]};
  }
  return out;
}

}  // namespace tessera::render
