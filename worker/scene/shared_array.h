#pragma once

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

namespace tessera::render {

/// Immutable array shared by its copies, so that data common to the frames of a job is stored once.
/// Safe to copy and read from any thread.
template <typename T>
class SharedArray {
 public:
  SharedArray() = default;
  // Implicit: takes ownership of a vector. NOLINTNEXTLINE(google-explicit-constructor)
  SharedArray(std::vector<T> values) {
    if (values.empty()) return;
    const auto storage = std::make_shared<const std::vector<T>>(std::move(values));
    data_ = storage->data();
    size_ = storage->size();
    owner_ = storage;
  }
  SharedArray(std::initializer_list<T> values) : SharedArray(std::vector<T>(values)) {}
  /// View of `size` values at `data`, which stay valid while `owner` lives.
  SharedArray(std::shared_ptr<const void> owner, const T* data, std::size_t size)
      : owner_(std::move(owner)), data_(data), size_(size) {}

  const T* data() const { return data_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  const T* begin() const { return data_; }
  const T* end() const { return data_ + size_; }
  const T& operator[](std::size_t i) const { return data_[i]; }

  friend bool operator==(const SharedArray& a, const SharedArray& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
  }

  /// Returns whether both share one storage; true for two empty arrays.
  bool shares(const SharedArray& other) const { return data_ == other.data_; }

 private:
  std::shared_ptr<const void> owner_;
  const T* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace tessera::render
