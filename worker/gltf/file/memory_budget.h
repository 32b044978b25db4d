#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

#include "absl/status/status.h"

namespace tessera::render {

/// Memory that this process can have, bytes: the least of the machine's memory, the limits of the
/// process's control groups (versions 1 and 2) and RLIMIT_DATA. `root`: where proc and sys are
/// found.
std::uint64_t machine_memory_bytes(const std::filesystem::path& root = "/");

/// Memory that is left for a scene while it is loaded. Counts the arrays that the scene keeps and
/// those that are about to be decoded, so that data that does not fit is refused before it is
/// decoded.
class MemoryBudget {
 public:
  explicit MemoryBudget(std::uint64_t bytes) : total_(bytes), left_(bytes) {}

  [[nodiscard]] std::uint64_t left() const { return left_; }
  /// Takes memory, at most what is left.
  void take(std::uint64_t bytes) { left_ -= bytes < left_ ? bytes : left_; }
  /// Errors: ResourceExhausted if less than `bytes` are left for `element`.
  [[nodiscard]] absl::Status check(std::string_view element, std::uint64_t bytes) const;

 private:
  std::uint64_t total_, left_;
};

}  // namespace tessera::render
