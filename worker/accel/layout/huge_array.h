#pragma once

#include <sys/mman.h>

#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>
#include <type_traits>

namespace tessera::render {

/// Array of fixed size on huge pages if it is large enough, which halves the cost of cache misses.
/// Copies share the elements, so write them before copying.
template <typename T>
class HugeArray {
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  HugeArray() = default;
  /// Value-initializes `count` elements. Throws std::bad_alloc.
  explicit HugeArray(std::size_t count) : size_(count) {
    if (count == 0) return;
    const std::size_t page = bytes() < kHugePage ? alignof(T) < 64 ? 64 : alignof(T) : kHugePage;
    capacity_ = (bytes() + page - 1) / page * page;
    data_ = static_cast<T*>(std::aligned_alloc(page, capacity_));
    if (data_ == nullptr) throw std::bad_alloc();
    owner_.reset(data_, [](T* p) { std::free(p); });
    if (page == kHugePage) ::madvise(data_, capacity_, MADV_HUGEPAGE);
    std::uninitialized_value_construct_n(data_, count);
  }

  T* data() { return data_; }
  const T* data() const { return data_; }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  T& operator[](std::size_t i) { return data_[i]; }
  const T& operator[](std::size_t i) const { return data_[i]; }
  /// Allocated bytes.
  std::size_t capacity_bytes() const { return capacity_; }

 private:
  static constexpr std::size_t kHugePage = std::size_t{1} << 21;
  std::size_t bytes() const { return size_ * sizeof(T); }

  std::shared_ptr<T> owner_;
  T* data_ = nullptr;
  std::size_t size_ = 0, capacity_ = 0;
};

}  // namespace tessera::render
