#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <vector>

namespace tessera::server {

/// The largest values of a stream, with memory for a given number of them.
class LargestValues {
 public:
  /// Requires count >= 1.
  explicit LargestValues(std::size_t count) : count_(count) {}

  void add(double value) {
    if (heap_.size() == count_) {
      if (value <= heap_.front()) return;
      std::pop_heap(heap_.begin(), heap_.end(), std::greater<>());
      heap_.back() = value;
    } else {
      heap_.push_back(value);
    }
    std::push_heap(heap_.begin(), heap_.end(), std::greater<>());
  }
  /// Returns whether no value up to `value` can be one of the largest.
  bool excludes(double value) const { return heap_.size() == count_ && value <= heap_.front(); }
  /// Returns the values so far, the smallest one first.
  const std::vector<double>& values() const { return heap_; }
  double sum() {
    std::sort(heap_.begin(), heap_.end());  // so that the sum does not depend on their order
    double total = 0;
    for (const double value : heap_) total += value;
    return total;
  }

 private:
  std::size_t count_;
  std::vector<double> heap_;  // smallest first
};

}  // namespace tessera::server
