#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <type_traits>
#include <utility>

namespace tessera::render {

/// A fixed number of plain elements, on huge pages where there are enough of them: a miss of the
/// caches costs half as much there.
template <typename T>
class HugeArray {
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  HugeArray() = default;
  /// `count` elements, each T(). Throws std::bad_alloc as new does.
  explicit HugeArray(std::size_t count) : size_(count) {
    if (count == 0) return;
    const std::size_t page = bytes() < kHugePage ? alignof(T) < 64 ? 64 : alignof(T) : kHugePage;
    capacity_ = (bytes() + page - 1) / page * page;
    data_.reset(static_cast<T*>(std::aligned_alloc(page, capacity_)));
    if (data_ == nullptr) throw std::bad_alloc();
    if (page == kHugePage) ::madvise(data_.get(), capacity_, MADV_HUGEPAGE);
    std::uninitialized_value_construct_n(data_.get(), count);
  }
  HugeArray(HugeArray&& other) noexcept
      : data_(std::move(other.data_)),
        size_(std::exchange(other.size_, 0)),
        capacity_(std::exchange(other.capacity_, 0)) {}
  HugeArray& operator=(HugeArray&& other) noexcept {
    data_ = std::move(other.data_);
    size_ = std::exchange(other.size_, 0);
    capacity_ = std::exchange(other.capacity_, 0);
    return *this;
  }

  T* data() { return data_.get(); }
  const T* data() const { return data_.get(); }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  T& operator[](std::size_t i) { return data_.get()[i]; }
  const T& operator[](std::size_t i) const { return data_.get()[i]; }
  /// What it takes up.
  std::size_t capacity_bytes() const { return capacity_; }

 private:
  static constexpr std::size_t kHugePage = std::size_t{1} << 21;
  struct Free {
    void operator()(T* p) const { std::free(p); }
  };
  std::size_t bytes() const { return size_ * sizeof(T); }

  std::unique_ptr<T, Free> data_;
  std::size_t size_ = 0, capacity_ = 0;
};

}  // namespace tessera::render
