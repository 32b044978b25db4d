#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>

#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

/// The indices of a sparse accessor.
struct SparseIndices {
  const std::byte* data = nullptr;
  std::int64_t count = 0, bytes = 0;  // bytes of an index

  std::uint32_t operator[](std::int64_t i) const;
};

/// Finds the sparse indices of accessor `index`; nullopt if it has none or their bytes are missing.
std::optional<SparseIndices> find_sparse_indices(const LinkedDocument& document,
                                                 std::int64_t index);

/// Reads the values of an accessor in order, with its sparse elements, without storing them.
class AccessorValues {
 public:
  /// Finds the bytes of accessor `index`; nullopt if it or its data are faulty or missing, or it
  /// has neither a view nor sparse elements.
  static std::optional<AccessorValues> open(const LinkedDocument& document, std::int64_t index);

  [[nodiscard]] std::int64_t count() const { return accessor_->count; }
  [[nodiscard]] std::int64_t components() const { return accessor_->components; }
  [[nodiscard]] bool is_float() const;

  /// Reads the next element: components() values. Requires that fewer than count() were read.
  void next(double* values);

  /// A value of an integer type as a fraction of its maximum, as of normalized accessors.
  [[nodiscard]] double normalized(double value) const;

 private:
  AccessorValues() = default;
  bool open_base(const LinkedDocument& document);
  bool open_sparse(const LinkedDocument& document, std::int64_t index);
  [[nodiscard]] double component(const std::byte* at) const;

  const LinkedAccessor* accessor_ = nullptr;
  const std::byte* base_ = nullptr;  // null: zeros
  SparseIndices sparse_;
  const std::byte* sparse_values_ = nullptr;
  std::int64_t stride_ = 0, rows_ = 0, row_stride_ = 0;
  std::int64_t sparse_next_ = 0;
  std::int64_t element_ = 0;
};

}  // namespace tessera::render
