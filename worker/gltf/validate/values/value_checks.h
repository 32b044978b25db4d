#pragma once

#include <cstdint>

#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

/// Number of values that may still be read. It bounds the time for files in which many accessors
/// or meshes read the same bytes.
class ValueBudget {
 public:
  explicit ValueBudget(std::uint64_t values) : left_(values) {}
  /// Takes `values` from the budget. If fewer are left, returns false and marks the result as
  /// partial.
  bool take(std::uint64_t values);
  [[nodiscard]] bool is_exhausted() const { return exhausted_; }

 private:
  std::uint64_t left_;
  bool exhausted_ = false;
};

/// Checks the values of the accessors: finite numbers, declared bounds, and the rules in
/// `document.value_checks`. Each rule is reported once for a pointer, with the first breach.
void check_accessor_values(LinkedDocument& document, ValueBudget& budget);

/// Checks joints and weights of the vertices of skinned meshes.
void check_skinned_vertices(LinkedDocument& document, ValueBudget& budget);

}  // namespace tessera::render
