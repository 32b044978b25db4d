#include "worker/gltf/validate/values/accessor_values.h"

#include <algorithm>
#include <cstring>

namespace tessera::render {

namespace {

template <typename T>
double read(const std::byte* at) {
  T value;
  std::memcpy(&value, at, sizeof value);  // glTF and all supported hosts are little endian
  return static_cast<double>(value);
}

/// Bytes of a view from `offset`, `length` of them; null if they do not exist.
const std::byte* view_bytes(const LinkedDocument& document, const LinkedView& view,
                            std::int64_t offset, std::int64_t length) {
  if (view.buffer == kNoIndex || view.offset < 0 || offset < 0 || length < 0) return nullptr;
  const BufferBytes& buffer = document.buffer_bytes[static_cast<std::size_t>(view.buffer)];
  const auto begin = static_cast<std::uint64_t>(view.offset) + static_cast<std::uint64_t>(offset);
  if (!buffer.present || begin > buffer.bytes.size() ||
      static_cast<std::uint64_t>(length) > buffer.bytes.size() - begin) {
    return nullptr;
  }
  return buffer.bytes.data() + begin;
}

}  // namespace

bool AccessorValues::is_float() const {
  return accessor_->format.component == kFloat;
}

double AccessorValues::component(const std::byte* at) const {
  switch (accessor_->format.component) {
    case 5120:
      return read<std::int8_t>(at);
    case 5121:
      return read<std::uint8_t>(at);
    case 5122:
      return read<std::int16_t>(at);
    case 5123:
      return read<std::uint16_t>(at);
    case 5125:
      return read<std::uint32_t>(at);
    default:
      return read<float>(at);
  }
}

double AccessorValues::normalized(double value) const {
  switch (accessor_->format.component) {
    case 5120:
      return std::max(value / 127, -1.0);
    case 5121:
      return value / 255;
    case 5122:
      return std::max(value / 32767, -1.0);
    case 5123:
      return value / 65535;
    case 5125:
      return value / 4294967295.0;
    default:
      return value;
  }
}

std::uint32_t SparseIndices::operator[](std::int64_t i) const {
  const std::byte* at = data + i * bytes;
  if (bytes == 1) return static_cast<std::uint32_t>(read<std::uint8_t>(at));
  if (bytes == 2) return static_cast<std::uint32_t>(read<std::uint16_t>(at));
  return static_cast<std::uint32_t>(read<std::uint32_t>(at));
}

void AccessorValues::next(double* values) {
  const LinkedAccessor& accessor = *accessor_;
  const std::int64_t size = accessor.component_bytes;
  const bool replaced = sparse_next_ < sparse_.count && sparse_[sparse_next_] == element_;
  for (std::int64_t i = 0; i < accessor.components; ++i) {
    if (replaced) {
      values[i] = component(sparse_values_ + (sparse_next_ * accessor.components + i) * size);
    } else if (base_ != nullptr) {
      values[i] =
          component(base_ + element_ * stride_ + i / rows_ * row_stride_ + i % rows_ * size);
    } else {
      values[i] = 0;
    }
  }
  if (replaced) ++sparse_next_;
  ++element_;
}

bool AccessorValues::open_base(const LinkedDocument& document) {
  const LinkedView& view = *document.view_of(*accessor_);
  stride_ = view.stride != -1 ? view.stride : accessor_->packed_stride();
  if (stride_ < accessor_->element_bytes()) return false;
  const std::int64_t length = stride_ * (accessor_->count - 1) + accessor_->element_bytes();
  if (!fits_view(view, accessor_->offset, accessor_->component_bytes, length, nullptr, "")) {
    return false;
  }
  base_ = view_bytes(document, view, accessor_->offset, length);
  return base_ != nullptr;
}

std::optional<SparseIndices> find_sparse_indices(const LinkedDocument& document,
                                                 std::int64_t index) {
  const JsonNode& sparse = (*document.accessors.get(index))["sparse"];
  const JsonNode& indices = sparse["indices"];
  const std::int64_t type = indices.integer("componentType");
  const std::int64_t view = indices.integer("bufferView");
  if (type == kNoIndex || document.buffer_views.get(view) == nullptr) return std::nullopt;
  SparseIndices out;
  out.count = sparse.integer("count");
  out.bytes = type == 5121 ? 1 : type == 5123 ? 2 : 4;
  out.data = view_bytes(document, document.views[static_cast<std::size_t>(view)],
                        indices.integer("byteOffset", 0), out.count * out.bytes);
  return out.data != nullptr ? std::optional(out) : std::nullopt;
}

bool AccessorValues::open_sparse(const LinkedDocument& document, std::int64_t index) {
  const auto indices = find_sparse_indices(document, index);
  if (!indices || indices->count > accessor_->count) return false;
  sparse_ = *indices;
  const JsonNode& sparse = (*document.accessors.get(index))["sparse"];
  const auto fits = [&](const char* part, std::int64_t size, std::int64_t length) {
    const std::int64_t view = sparse[part].integer("bufferView");
    return document.buffer_views.get(view) != nullptr &&
           fits_view(document.views[static_cast<std::size_t>(view)],
                     sparse[part].integer("byteOffset", 0), size, length, nullptr, "");
  };
  const std::int64_t length = accessor_->component_bytes * accessor_->components * sparse_.count;
  if (!fits("indices", sparse_.bytes, sparse_.bytes * sparse_.count) ||
      !fits("values", accessor_->component_bytes, length)) {
    return false;
  }
  const std::int64_t view = sparse["values"].integer("bufferView");
  sparse_values_ = view_bytes(document, document.views[static_cast<std::size_t>(view)],
                              sparse["values"].integer("byteOffset", 0), length);
  return sparse_values_ != nullptr;
}

std::optional<AccessorValues> AccessorValues::open(const LinkedDocument& document,
                                                   std::int64_t index) {
  if (document.accessors.get(index) == nullptr) return std::nullopt;
  AccessorValues out;
  out.accessor_ = &document.linked_accessors[static_cast<std::size_t>(index)];
  const LinkedAccessor& accessor = *out.accessor_;
  if (!accessor.is_complete() || (accessor.view == kNoIndex && !accessor.has_sparse)) {
    return std::nullopt;
  }
  const std::string_view type = accessor.format.type;
  const std::int64_t columns = type == "MAT2" ? 2 : type == "MAT3" ? 3 : type == "MAT4" ? 4 : 1;
  out.rows_ = accessor.components / columns;
  out.row_stride_ = (out.rows_ * accessor.component_bytes + 3) / 4 * 4;
  if (accessor.view != kNoIndex && !out.open_base(document)) return std::nullopt;
  if (accessor.has_sparse && !out.open_sparse(document, index)) return std::nullopt;
  return out;
}

}  // namespace tessera::render
