#include "worker/agent/worker_id.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <random>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {
namespace {

constexpr int kMaxWorkers = 1024;  // of a host, with one cache directory
constexpr std::string_view kPrefix = "w-";
constexpr std::string_view kDigits = "0123456789abcdef";
constexpr std::size_t kDigitCount = 16;

std::string random_id() {
  std::random_device random;
  std::string id(kPrefix);
  for (std::size_t i = 0; i < kDigitCount; ++i) id += kDigits[random() % kDigits.size()];
  return id;
}

bool is_id(std::string_view text) {
  return text.size() == kPrefix.size() + kDigitCount && text.substr(0, kPrefix.size()) == kPrefix &&
         text.find_first_not_of(kDigits, kPrefix.size()) == std::string_view::npos;
}

/// Returns the ID in the file, or a new one that it writes there; "" if it cannot.
std::string read_or_write_id(int file) {
  std::array<char, kPrefix.size() + kDigitCount> buffer{};
  const ssize_t count = ::pread(file, buffer.data(), buffer.size(), 0);
  if (count < 0) return "";
  const std::string_view text(buffer.data(), static_cast<std::size_t>(count));
  if (is_id(text)) return std::string(text);
  const std::string id = random_id();
  const ssize_t written = ::pwrite(file, id.data(), id.size(), 0);
  return written == static_cast<ssize_t>(id.size()) ? id : "";
}

}  // namespace

WorkerId claim_worker_id(const std::string& cache_folder, const std::string& host) {
  std::string name = host;
  std::replace(name.begin(), name.end(), '/', '_');
  for (int number = 1; number <= kMaxWorkers; ++number) {
    const std::string path = absl::StrCat(cache_folder, "/", name, "-", number, ".id");
    Descriptor file(::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600));
    if (!file) break;
    if (::flock(file.get(), LOCK_EX | LOCK_NB) != 0) {
      if (errno == EWOULDBLOCK) continue;  // of a worker that is running
      break;
    }
    std::string id = read_or_write_id(file.get());
    if (id.empty()) break;
    return {std::move(id), std::move(file)};
  }
  return {random_id(), Descriptor()};
}

}  // namespace tessera::agent
