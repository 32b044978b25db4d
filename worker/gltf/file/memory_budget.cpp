#include "worker/gltf/file/memory_budget.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace tessera::render {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kUnlimited = std::numeric_limits<std::uint64_t>::max();

/// A number that is the whole file; kUnlimited if there is none ("max").
std::uint64_t number_in(const fs::path& file) {
  std::ifstream in(file);
  std::string word;
  std::uint64_t number = 0;
  return in >> word && absl::SimpleAtoi(word, &number) ? number : kUnlimited;
}

/// The least limit of a control group and those that contain it. In a container the group's path
/// is often that of the host, of which only the top is mounted.
std::uint64_t group_limit(const fs::path& mount, const fs::path& group, const char* file) {
  std::uint64_t least = kUnlimited;
  fs::path at = mount;
  const auto extend = [&] { least = std::min(least, number_in(at / file)); };
  extend();
  for (const fs::path& part : group.relative_path()) {
    at /= part;
    extend();
  }
  return least;
}

/// Lines are "NUMBER:CONTROLLERS:PATH"; version 2 names no controllers.
std::uint64_t control_group_limit(const fs::path& root) {
  std::ifstream in(root / "proc/self/cgroup");
  const fs::path mount = root / "sys/fs/cgroup";
  std::uint64_t least = kUnlimited;
  for (std::string line; std::getline(in, line);) {
    const std::size_t first = line.find(':');
    const std::size_t second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const std::string group = line.substr(second + 1);
    if (controllers.empty()) least = std::min(least, group_limit(mount, group, "memory.max"));
    if (controllers == "memory") {
      least = std::min(least, group_limit(mount / "memory", group, "memory.limit_in_bytes"));
    }
  }
  return least;
}

}  // namespace

std::uint64_t machine_memory_bytes(const fs::path& root) {
  std::uint64_t least = control_group_limit(root);
  const long pages = ::sysconf(_SC_PHYS_PAGES), page = ::sysconf(_SC_PAGESIZE);
  if (pages > 0 && page > 0) {
    least = std::min(least, static_cast<std::uint64_t>(pages) * static_cast<std::uint64_t>(page));
  }
  rlimit data{};
  if (::getrlimit(RLIMIT_DATA, &data) == 0 && data.rlim_cur != RLIM_INFINITY) {
    least = std::min(least, static_cast<std::uint64_t>(data.rlim_cur));
  }
  return least;
}

absl::Status MemoryBudget::check(std::string_view element, std::uint64_t bytes) const {
  if (bytes <= left_) return absl::OkStatus();
  return absl::ResourceExhaustedError(absl::StrCat(
      std::string(element), ": takes ", bytes, " bytes decoded, more than the ", left_, " left of ",
      total_,
      " bytes of memory; simplify the scene, or give it a machine with more memory or a higher "
      "memory limit"));
}

}  // namespace tessera::render
