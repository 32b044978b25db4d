#include "worker/gltf/file/folder_reader.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "worker/gltf/file/memory_budget.h"

namespace tessera::render {

namespace fs = std::filesystem;

namespace {

/// Closes a file descriptor at the end of its scope.
struct Descriptor {
  int number = -1;
  explicit Descriptor(int n) : number(n) {}
  ~Descriptor() {
    if (number >= 0) ::close(number);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
};

/// A fault with a path. Contains no ": ", which would be taken for an element in "FILE: ELEMENT:
/// FAULT".
std::string fault_at(const char* fault, const fs::path& path) {
  return absl::StrCat(fault, " (", path.string(), ")");
}

bool is_beneath(const fs::path& path, const fs::path& folder) {
  const auto mismatch = std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
  return mismatch.first == folder.end();
}

}  // namespace

FolderReader::FolderReader(const fs::path& folder) : memory_bytes_(machine_memory_bytes()) {
  std::error_code error;
  folder_ = fs::canonical(folder.empty() ? fs::path(".") : folder, error);
}

FolderReader::~FolderReader() {
  for (const auto& [uri, file] : files_) {
    if (file.size > 0) ::munmap(const_cast<std::byte*>(file.data), file.size);
  }
}

void FolderReader::allow(std::string uri, fs::path path) {
  allowed_[std::move(uri)] = std::move(path);
}

absl::StatusOr<fs::path> FolderReader::resolve(std::string_view uri) const {
  std::error_code error;
  if (const auto known = allowed_.find(uri); known != allowed_.end()) {
    const fs::path path = fs::canonical(known->second, error);
    if (error) return absl::NotFoundError(fault_at("no such file", known->second));
    return path;
  }
  const fs::path relative{std::string(uri)};
  if (folder_.empty()) return absl::NotFoundError("the scene's directory does not exist");
  if (relative.empty() || relative.is_absolute() ||
      std::find(relative.begin(), relative.end(), "..") != relative.end()) {
    return absl::PermissionDeniedError("the path leaves the scene's directory");
  }
  const fs::path path = fs::canonical(folder_ / relative, error);
  if (error) return absl::NotFoundError(fault_at("no such file", folder_ / relative));
  if (!is_beneath(path, folder_)) {
    return absl::PermissionDeniedError("a symbolic link leaves the scene's directory");
  }
  return path;
}

absl::StatusOr<std::span<const std::byte>> FolderReader::read(std::string_view uri) {
  if (const auto known = files_.find(uri); known != files_.end()) {
    return std::span<const std::byte>(known->second.data, known->second.size);
  }
  const auto path = resolve(uri);
  if (!path.ok()) return path.status();
  // The path is canonical; O_NOFOLLOW rejects a link that has been created since.
  const Descriptor file(::open(path->c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  struct stat info = {};
  if (file.number < 0 || ::fstat(file.number, &info) != 0 || !S_ISREG(info.st_mode)) {
    return absl::PermissionDeniedError(fault_at("not a readable file", *path));
  }
  Mapping mapping{*path, nullptr, static_cast<std::size_t>(info.st_size)};
  if (mapping.size > 0) {
    void* data = ::mmap(nullptr, mapping.size, PROT_READ, MAP_PRIVATE, file.number, 0);
    if (data == MAP_FAILED) {
      return absl::PermissionDeniedError(fault_at("cannot be read", *path));
    }
    mapping.data = static_cast<const std::byte*>(data);
  }
  uris_.emplace_back(uri);
  const Mapping& kept = files_[std::string(uri)] = mapping;
  return std::span<const std::byte>(kept.data, kept.size);
}

fs::path FolderReader::path_of(std::string_view uri) const {
  const auto known = files_.find(uri);
  return known == files_.end() ? fs::path() : known->second.path;
}

}  // namespace tessera::render
